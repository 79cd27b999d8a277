"""Cuts square windows around targets, turned by their angle, and says which of them to distrust."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.feature_space import FLAT_DEVIATION
from streamkit_wavelet_eigen.square_windows import DEVIATION, EXTENT, OUTSIDE, TURN, cut_squares

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
    places = np.ascontiguousarray(places, np.float64).reshape(-1, 5)
    patches, facts = np.zeros((len(places), patch, patch), np.float32), np.empty((len(places), 7))
    cut_squares(image, places, margin, patches, facts)
    for index in np.flatnonzero(facts[:, TURN]).tolist():
        _, x, y, side, angle, _, _ = facts[index].tolist()
        patches[index] = _turned(image, x, y, int(side), angle, patch)
        facts[index, DEVIATION] = patches[index].std()
        facts[index, OUTSIDE] = _share_outside(x, y, int(side), angle, width, height)
    flat, tiny = facts[:, DEVIATION] < FLAT_DEVIATION, facts[:, EXTENT] < TINY_SIDE
    return Windows(patches, flat, facts[:, OUTSIDE].copy(), tiny)


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


def _share_outside(x: float, y: float, side: int, angle: float, width: int, height: int) -> float:
    """Share of a turned square outside the picture, by points all over it."""
    steps = ((np.arange(PROBES) + 0.5) / PROBES - 0.5) * side
    along, across = np.meshgrid(steps, steps)
    columns = x + math.cos(angle) * along - math.sin(angle) * across
    rows = y + math.sin(angle) * along + math.cos(angle) * across
    inside = (columns >= -0.5) & (columns <= width - 0.5) & (rows >= -0.5) & (rows <= height - 0.5)
    return 1.0 - float(inside.mean())
