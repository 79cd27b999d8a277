"""Boxes and centroids refined at full resolution.

The foreground includes every pixel that differs from the background by some deviations of its noise, also
those that an object covers by a tenth. An object's edge lies where about half of its contrast is reached.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_differencer.arrays import (
    BOUNDS,
    CORNERS,
    Bounds,
    ByteImage,
    Corners,
    Flags,
    FloatArray,
    overlaps,
)
from streamkit_differencer.foreground import MAX_BACKGROUND
from streamkit_differencer.objects import Objects
from streamkit_differencer.warping import mapped_into
from streamkit_kernels import BOOL_1D, FLOAT64, UINT8, UINT8_STRIDED, compiled, kernel

# Share of the mean contrast at an object's edge; pixels around the object lower that mean.
EDGE_SHARE = 0.4
# Larger objects gain nothing.
MAX_PX = 256
# Columns of the result.
BOX, CENTROID, AREA = slice(0, 4), slice(4, 6), 6


class FrameImages(NamedTuple):
    """A frame with its background and foreground, in which objects are measured.

    Attributes:
        image: uint8[h, w], the frame at full resolution.
        background: uint8, its border is replicated.
        to_background: float64[3, 3], frame pixels to those of `background`.
        mask: uint8, the frame's foreground at the working scale.
        scale: frame pixels per working pixel.
    """

    image: ByteImage
    background: ByteImage
    to_background: FloatArray
    mask: ByteImage
    scale: int


def refine_objects(objects: Objects, images: FrameImages) -> Objects:
    """The objects with boxes, centroids and areas measured at full resolution.

    Objects with overlapping boxes, and those that hardly differ from the background, stay as they are.
    """
    if not len(objects):
        return objects
    corners = np.rint(objects.boxes + 0.5).astype(np.int64)
    is_alone = overlaps(objects.boxes, objects.boxes).sum(axis=1) == 1
    found = measured_at_full_resolution(*images, corners, is_alone)
    better = found[:, AREA] > 0.0
    return replace(
        objects,
        boxes=np.where(better[:, None], found[:, BOX], objects.boxes),
        centroids=np.where(better[:, None], found[:, CENTROID], objects.centroids),
        areas=np.where(better, found[:, AREA], objects.areas),
    )


@kernel(UINT8_STRIDED, UINT8_STRIDED, FLOAT64, UINT8, types.int64, CORNERS, BOOL_1D)
def measured_at_full_resolution(
    image: ByteImage,
    background: ByteImage,
    to_background: FloatArray,
    mask: ByteImage,
    scale: int,
    corners: Corners,
    chosen: Flags,
) -> FloatArray:
    """Measures the objects in some boxes.

    Args:
        image: see `FrameImages`, as the next four.
        background: the same.
        to_background: the same.
        mask: the same.
        scale: the same.
        corners: int64[n, 4], first column and row, and those after the last.
        chosen: bool[n], mask of the boxes.

    Returns:
        float64[n, 7], px: outer edges x0 y0 x1 y1, centroid x y, and area; area 0 where the contrast is too
        small.
    """
    found = np.zeros((len(corners), 7))
    contrasts = np.empty(MAX_PX * MAX_PX, np.int16)
    columns = np.empty(MAX_PX, np.uint32)
    for number in range(len(corners)):
        left, top = max(corners[number, 0], 0), max(corners[number, 1], 0)
        right, bottom = min(corners[number, 2], image.shape[1]), min(corners[number, 3], image.shape[0])
        width, height = right - left, bottom - top
        if not chosen[number] or min(width, height) <= 0 or max(width, height) > MAX_PX:
            continue
        box = left, top, width, height
        mean = _find_contrasts(image, background, to_background, mask, scale, box, columns, contrasts)
        _outline(contrasts, box, EDGE_SHARE * mean, found[number])
    return found


@kernel(UINT8_STRIDED, UINT8_STRIDED, FLOAT64, UINT8, types.int64, BOUNDS)
def clear_foreground(
    image: ByteImage,
    background: ByteImage,
    to_background: FloatArray,
    mask: ByteImage,
    scale: int,
    bounds: Bounds,
) -> ByteImage:
    """The foreground in a part of the frame at full resolution, as far as its contrast is that of an object.

    Args:
        image: see `FrameImages`, as the next four.
        background: the same.
        to_background: the same.
        mask: the same.
        scale: the same.
        bounds: first row and the one after the last, first column and the one after the last, in the frame.

    Returns:
        uint8[rows, columns], values of `mask`, 0 between objects.
    """
    top, bottom, left, right = bounds
    width, height = right - left, bottom - top
    contrasts, columns = np.empty(width * height, np.int16), np.empty(width, np.uint32)
    box = left, top, width, height
    mean = _find_contrasts(image, background, to_background, mask, scale, box, columns, contrasts)
    result = np.zeros((height, width), np.uint8)
    for row in range(height):
        line = mask[min((top + row) // scale, mask.shape[0] - 1)]
        for column in range(width):
            if contrasts[row * width + column] > EDGE_SHARE * mean:
                result[row, column] = line[columns[column]]
    return result


@compiled
def _find_contrasts(
    image: ByteImage,
    background: ByteImage,
    to_background: FloatArray,
    mask: ByteImage,
    scale: int,
    box: tuple[int, int, int, int],
    columns: NDArray[np.uint32],
    contrasts: NDArray[np.int16],
) -> float:
    """The contrast of each pixel of a box, -1 outside the foreground; returns the mean of the others.

    `box` is the box's first column and row, its width and height; `columns` becomes those in the mask.
    """
    left, top, width, height = box
    inside, total = 0, 0
    for column in range(width):
        # A division for each pixel takes as long as all else.
        columns[column] = min((left + column) // scale, mask.shape[1] - 1)
    for row in range(top, top + height):
        line = mask[min(row // scale, mask.shape[0] - 1)]
        for column in range(left, left + width):
            index = (row - top) * width + column - left
            contrasts[index] = -1
            if line[columns[column - left]] > MAX_BACKGROUND:
                contrasts[index] = abs(
                    np.int64(image[row, column]) - background_at(background, to_background, row, column)
                )
                inside += 1
                total += contrasts[index]
    return total / max(inside, 1)


@compiled
def background_at(background: ByteImage, to_background: FloatArray, row: int, column: int) -> int:
    """The background at a pixel of the frame, by bilinear interpolation, rounded."""
    height, width = background.shape
    x, y = mapped_into(to_background, column, row, background.shape)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    across, down = x - left, y - top
    upper = background[top, left] * (1.0 - across) + background[top, right] * across
    lower = background[bottom, left] * (1.0 - across) + background[bottom, right] * across
    return int(upper * (1.0 - down) + lower * down + 0.5)


@compiled
def _outline(
    contrasts: NDArray[np.int16],
    box: tuple[int, int, int, int],
    edge: float,
    found: NDArray[np.float64],
) -> None:
    """Box, centroid and area of the pixels that exceed an edge."""
    first_x, first_y, width, height = box
    area, sum_x, sum_y = 0, 0, 0
    left, top, right, bottom = first_x + width, first_y + height, first_x, first_y
    for row in range(first_y, first_y + height):
        for column in range(first_x, first_x + width):
            if contrasts[(row - first_y) * width + column - first_x] > edge:
                area, sum_x, sum_y = area + 1, sum_x + column, sum_y + row
                left, top = min(left, column), min(top, row)
                right, bottom = max(right, column + 1), max(bottom, row + 1)
    if area > 0:
        found[0], found[1], found[2], found[3] = left - 0.5, top - 0.5, right - 0.5, bottom - 0.5
        found[4], found[5], found[6] = sum_x / area, sum_y / area, area
