"""Cuts square windows around targets, turned by their angle, and says which of them to distrust."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.feature_space import flat_windows

# Pixels; a smaller target is mostly blur and compression.
TINY_SIDE = 8
# Points per side at which a turned window is asked how much of it lies in the picture.
PROBES = 16


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of one frame, one per target.

    Attributes:
        patches: float32[n, patch, patch], grey levels 0..255.
        flat: bool[n], the window shows no structure (deviation below 4 grey levels).
        clipped: float64[n], share of the window's area outside the picture, 0..1.
        tiny: bool[n], the target is smaller than 8 px on its longer side, so the window is mostly blur.
    """

    patches: NDArray[np.float32]
    flat: NDArray[np.bool_]
    clipped: NDArray[np.float64]
    tiny: NDArray[np.bool_]


def box_places(centroids: NDArray[np.float64], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places of upright boxes for `cut_windows`.

    Args:
        centroids: float64[n, 2], x y px.
        boxes: float64[n, 4], x0 y0 x1 y1 px.

    Returns:
        float64[n, 5], x y length width angle.
    """
    centroids, boxes = np.reshape(centroids, (-1, 2)), np.reshape(boxes, (-1, 4))
    return np.column_stack([centroids, boxes[:, 2:] - boxes[:, :2], np.zeros(len(boxes))])


def cut_windows(
    image: NDArray[np.uint8], places: NDArray[np.float64], patch: int, margin: float = 1.25
) -> Windows:
    """Cuts a square around each target, scaled to one size.

    The square is centred on the target, to a fraction of a pixel, and as wide as its longer side times the
    margin; its rows run along the target's angle. What lies outside the picture is filled with its nearest
    pixel. A window is never wider than the picture's longer side.

    Args:
        image: uint8[h, w].
        places: float64[n, 5], x y length width in px, and angle in rad from +x towards +y.
        patch: side of the windows, pixels.
        margin: how much wider than the target the square is.

    Returns:
        The windows; a target whose numbers are not finite has an all-zero patch, flat and wholly clipped.
    """
    height, width = image.shape
    places = np.reshape(np.asarray(places, np.float64), (-1, 5))
    valid = np.asarray(np.isfinite(places).all(axis=1))
    extents = np.where(valid, places[:, 2:4].max(axis=1), 0.0)
    # A box may be as large as a float: the margin then has to come after the limit.
    sides = np.clip(np.rint(np.minimum(extents, 4.0 * max(height, width)) * margin), 1, max(height, width))
    # Farther out every window is the same edge pixels, and the coordinates would overflow OpenCV's int.
    farthest = np.array([[width, height]]) + sides[:, None]
    centres = np.clip(np.nan_to_num(places[:, :2]), -sides[:, None], farthest)
    patches = np.zeros((len(places), patch, patch), np.float32)
    clipped = np.ones(len(places))
    for index in np.flatnonzero(valid).tolist():
        (x, y), side = centres[index].tolist(), int(sides[index])
        angle = math.remainder(float(places[index, 4]), 2 * math.pi)
        if angle == 0.0:
            patches[index] = _upright(image, x, y, side, patch)
            clipped[index] = 1.0 - _share_inside(x, side, width) * _share_inside(y, side, height)
        else:
            patches[index] = _turned(image, x, y, side, angle, patch)
            clipped[index] = _share_outside(x, y, side, angle, width, height)
    return Windows(patches, flat_windows(patches), clipped, extents < TINY_SIDE)


def _upright(image: NDArray[np.uint8], x: float, y: float, side: int, patch: int) -> NDArray[np.uint8]:
    window = cv2.getRectSubPix(image, (side, side), (x, y))
    shrink = cv2.INTER_AREA if side > patch else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(window, (patch, patch), interpolation=shrink), np.uint8)


def _turned(
    image: NDArray[np.uint8], x: float, y: float, side: int, angle: float, patch: int
) -> NDArray[np.uint8]:
    height, width = image.shape
    reach = math.ceil(side * math.sqrt(0.5)) + 2
    left, top = (int(min(max(place - reach, 0), end - 1)) for place, end in ((x, width), (y, height)))
    right, bottom = int(max(min(x + reach, width), left + 1)), int(max(min(y + reach, height), top + 1))
    crop, across, down = image[top:bottom, left:right], 1.0, 1.0
    if side > patch:
        # A linear warp reads four pixels only: what shrinks is averaged down first.
        size = (max(round((right - left) * patch / side), 1), max(round((bottom - top) * patch / side), 1))
        across, down = size[0] / (right - left), size[1] / (bottom - top)
        crop = np.asarray(cv2.resize(crop, size, interpolation=cv2.INTER_AREA), np.uint8)
    step, middle = side / patch, (patch - 1) / 2
    cosine, sine = math.cos(angle) * step, math.sin(angle) * step
    matrix = np.array(
        [
            [cosine * across, -sine * across, (x - left - (cosine - sine) * middle + 0.5) * across - 0.5],
            [sine * down, cosine * down, (y - top - (sine + cosine) * middle + 0.5) * down - 0.5],
        ]
    )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    turned = cv2.warpAffine(crop, matrix, (patch, patch), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(turned, np.uint8)


def _share_inside(centre: float, side: int, length: int) -> float:
    """Share of [centre - side / 2, centre + side / 2] within the pixels 0 .. length - 1."""
    first, last = max(centre - side / 2, -0.5), min(centre + side / 2, length - 0.5)
    return max(last - first, 0.0) / side


def _share_outside(x: float, y: float, side: int, angle: float, width: int, height: int) -> float:
    """Share of a turned square outside the picture, by points all over it."""
    steps = ((np.arange(PROBES) + 0.5) / PROBES - 0.5) * side
    along, across = np.meshgrid(steps, steps)
    columns = x + math.cos(angle) * along - math.sin(angle) * across
    rows = y + math.sin(angle) * along + math.cos(angle) * across
    inside = (columns >= -0.5) & (columns <= width - 0.5) & (rows >= -0.5) & (rows <= height - 0.5)
    return 1.0 - float(inside.mean())
