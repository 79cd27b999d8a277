"""Cuts square windows around targets, rotated by their angle, and flags those of little use."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.feature_space import flat_windows

# px; a smaller target is mostly blur and compression.
TINY_SIDE = 8


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of one frame, one per target.

    Attributes:
        patches: float32[n, patch, patch], grey levels 0..255.
        flat: bool[n], the window shows no structure (deviation below 4 grey levels).
        clipped: float64[n], share of the window's area outside the frame, 0..1.
        tiny: bool[n], the target is below 8 px on its longer side.
    """

    patches: NDArray[np.float32]
    flat: NDArray[np.bool_]
    clipped: NDArray[np.float64]
    tiny: NDArray[np.bool_]


def rotated_boxes(centroids: NDArray[np.float64], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Converts upright boxes to rotated boxes with angle 0.

    Args:
        centroids: float64[n, 2], x y px.
        boxes: float64[n, 4], x0 y0 x1 y1 px.

    Returns:
        float64[n, 5], x y length width angle.
    """
    centroids, boxes = np.reshape(centroids, (-1, 2)), np.reshape(boxes, (-1, 4))
    return np.column_stack([centroids, boxes[:, 2:] - boxes[:, :2], np.zeros(len(boxes))])


def cut_windows(
    image: NDArray[np.uint8], boxes: NDArray[np.float64], patch: int, margin: float = 1.25
) -> Windows:
    """Cuts a square around each target, scaled to one size.

    The square is centred on the target with sub-pixel accuracy. Its side is the target's longer side times
    the margin, at most the longer side of the image; its rows run along the target's angle. Outside the
    image the nearest pixel is replicated.

    Args:
        image: uint8[h, w].
        boxes: float64[n, 5], x y length width in px, and angle in rad from +x towards +y.
        patch: side of the windows, px.
        margin: side of the square over the target's longer side.

    Returns:
        The windows; a box that is not finite gives an all-zero patch, flat and fully clipped.
    """
    height, width = image.shape
    boxes = np.asarray(boxes, np.float64).reshape(-1, 5)
    is_finite = np.asarray(np.isfinite(boxes).all(axis=1))
    boxes = np.where(is_finite[:, None], boxes, 0.0)
    patches = np.zeros((len(boxes), patch, patch), np.float32)
    # Limited before the margin is applied: a box may be as large as a float.
    longest = max(height, width)
    sides = np.minimum(boxes[:, 2:4].max(axis=1), 4.0 * longest) * margin
    sides = np.rint(np.clip(sides, 1.0, longest)).astype(int)
    # Farther out every window has the same edge pixels.
    centres = np.clip(boxes[:, :2], -sides[:, None], sides[:, None] + (width, height))
    clipped = np.ones(len(boxes))
    frame = cv2.boxPoints((((width - 1) / 2, (height - 1) / 2), (width, height), 0.0))
    for index in np.flatnonzero(is_finite):
        (x, y), side, angle = centres[index].tolist(), int(sides[index]), boxes[index, 4] % (2 * math.pi)
        if angle:
            patches[index] = _cut_rotated(image, x, y, side, angle, patch)
        else:
            _cut_upright(image, x, y, side, patches[index])
        square = cv2.boxPoints(((x, y), (side, side), math.degrees(angle)))
        covered = cv2.intersectConvexConvex(square, frame)[0] / side**2
        clipped[index] = max(round(1.0 - covered, 4), 0.0)
    np.rint(patches, out=patches)
    return Windows(patches, flat_windows(patches), clipped, boxes[:, 2:4].max(axis=1) < TINY_SIDE)


def _cut_upright(image: NDArray[np.uint8], x: float, y: float, side: int, patch: NDArray[np.float32]) -> None:
    """Shifted by part of a pixel, then scaled; without rotation that is sharper than a warp."""
    height, width = image.shape
    left, top = x - (side - 1) / 2, y - (side - 1) / 2
    # At least one pixel of the image; a square farther out would show the same.
    column = min(max(math.floor(left), -side), width - 1)
    row = min(max(math.floor(top), -side), height - 1)
    part = image[max(row, 0) : row + side + 1, max(column, 0) : column + side + 1]
    above, before = max(-row, 0), max(-column, 0)
    border = above, side + 1 - above - part.shape[0], before, side + 1 - before - part.shape[1]
    if any(border):
        part = np.asarray(cv2.copyMakeBorder(part, *border, cv2.BORDER_REPLICATE), np.uint8)
    across, down = np.array([1 - left % 1, left % 1]), np.array([1 - top % 1, top % 1])
    shifted = cv2.sepFilter2D(part, cv2.CV_32F, across, down, anchor=(0, 0))[:side, :side]
    scaling = cv2.INTER_AREA if side > len(patch) else cv2.INTER_LINEAR
    cv2.resize(shifted, patch.shape, patch, interpolation=scaling)


def _cut_rotated(
    image: NDArray[np.uint8], x: float, y: float, side: int, angle: float, patch: int
) -> NDArray[np.uint8]:
    height, width = image.shape
    reach = math.ceil(side * math.sqrt(0.5)) + 2
    left, top = (int(min(max(centre - reach, 0), end - 1)) for centre, end in ((x, width), (y, height)))
    right, bottom = int(max(min(x + reach, width), left + 1)), int(max(min(y + reach, height), top + 1))
    crop, across, down = image[top:bottom, left:right], 1.0, 1.0
    if side > patch:
        # A linear warp reads four pixels only: average before it shrinks.
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
    rotated = cv2.warpAffine(crop, matrix, (patch, patch), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(rotated, np.uint8)
