"""Boxes in an image: turned ones, the upright box around one, and how much upright boxes overlap."""

from __future__ import annotations

import math

import numpy as np

from streamkit.geometry.homography import FloatArray


def upright_sides(length: float, width: float, angle: float) -> tuple[float, float]:
    """Width and height of the upright box around a turned one, px.

    Args:
        length: side along the angle, px.
        width: side across it, px.
        angle: from +x towards +y, rad.
    """
    cosine, sine = abs(math.cos(angle)), abs(math.sin(angle))
    return length * cosine + width * sine, length * sine + width * cosine


def parse_turned_box(text: str) -> FloatArray:
    """The turned box float64[5], x y length width angle, that a person gives as "x,y,w,h" or "x,y,w,h,angle".

    In the text x and y are the left and top pixel of the box before it is turned about its centre; px, rad.

    Raises:
        ValueError: it is not four or five finite numbers with a positive size.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (4, 5) or not all(map(math.isfinite, numbers)) or min(numbers[2:4]) <= 0:
        raise ValueError(
            f'must be "x,y,w,h" or "x,y,w,h,angle" with w and h above 0, got "{text}"; '
            "for example 100,80,48,32"
        )
    left, top, width, height, angle = [*numbers, 0.0][:5]
    return np.array([left + (width - 1) / 2, top + (height - 1) / 2, width, height, angle])


def box_iou(first: FloatArray, second: FloatArray) -> FloatArray:
    """Intersection over union of every pair of upright boxes.

    Args:
        first: float64[n, 4], x0 y0 x1 y1, px.
        second: float64[m, 4].

    Returns:
        float64[n, m], 0 to 1; boxes without area overlap nothing.
    """
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0.0), axis=2)
    areas = [np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0), axis=1) for boxes in (first, second)]
    union = areas[0][:, None] + areas[1][None] - common
    shares: FloatArray = np.divide(common, union, out=np.zeros_like(union), where=union > 0)
    return shares
