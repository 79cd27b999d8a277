"""Boxes and centroids refined at full resolution, in the small piece of the frame where an object was found.

Foreground takes in whatever differs from the ground by some deviations of its noise: also the pixels around a
thing that it covers by a tenth. Its edge lies where about half of its contrast is reached.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numba import types

from streamkit_differencer.objects import LOWEST_MARK, Objects
from streamkit_kernels import BYTES, FLAGS, TABLE, VIEW, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatArray = NDArray[np.float64]
    Corners = NDArray[np.int64]
    Flags = NDArray[np.bool_]

# A thing's edge lies where this share of its mean contrast is reached; pixels around it lower that mean.
EDGE_SHARE = 0.4
# What would shrink to less than this share of its area has parts as grey as the ground, and is left as it is.
LEAST_AREA = 0.35
# Larger things gain nothing.
LARGEST_PX = 256
# Columns of what is found.
BOX, CENTROID, AREA = slice(0, 4), slice(4, 6), 6


def refined(
    objects: Objects, image: ByteImage, ground: ByteImage, to_ground: FloatArray, mask: ByteImage, scale: int
) -> Objects:
    """The objects with boxes, centroids and areas measured on the frame itself.

    One whose box overlaps another's is left as it is, and so is one that hardly differs from the ground.

    Args:
        objects: as measured on the foreground.
        image: uint8[h, w], the frame at full resolution.
        ground: uint8[h, w], the background.
        to_ground: float64[3, 3], pixels of the frame to those of `ground`.
        mask: uint8[h, w], the frame's foreground at the working scale.
        scale: frame pixels per working pixel.
    """
    if not len(objects):
        return objects
    corners = np.rint(objects.boxes + 0.5).astype(np.int64)
    found = edges_of(image, ground, to_ground, mask, scale, corners, alone(objects.boxes))
    better = found[:, AREA] > 0.0
    return replace(
        objects,
        boxes=np.where(better[:, None], found[:, BOX], objects.boxes),
        centroids=np.where(better[:, None], found[:, CENTROID], objects.centroids),
        areas=np.where(better, found[:, AREA], objects.areas),
    )


def alone(boxes: FloatArray) -> NDArray[np.bool_]:
    """Which boxes overlap no other, bool[n]: in the others the foreground may be another's."""
    meets = (boxes[:, None, :2] < boxes[None, :, 2:]).all(axis=2)
    return np.asarray((meets & meets.T).sum(axis=1) == 1)


@kernel(VIEW, VIEW, TABLE, BYTES, types.int64, types.Array(types.int64, 2, "C"), FLAGS)
def edges_of(
    image: ByteImage,
    ground: ByteImage,
    to_ground: FloatArray,
    mask: ByteImage,
    scale: int,
    corners: Corners,
    chosen: Flags,
) -> FloatArray:
    """Where the things in some boxes are.

    Args:
        image: uint8[h, w], the frame at full resolution.
        ground: uint8, the background; beyond its border it goes on as on it.
        to_ground: float64[3, 3], pixels of the frame to those of `ground`.
        mask: uint8, the frame's foreground at the working scale.
        scale: frame pixels per working pixel.
        corners: int64[n, 4], first column and row, and those after the last.
        chosen: bool[n], which boxes are looked at.

    Returns:
        float64[n, 7], px: outer edges x0 y0 x1 y1, centroid x y, and area, which is 0 where the contrast does
        not tell.
    """
    found = np.zeros((len(corners), 7))
    room = np.empty(LARGEST_PX * LARGEST_PX, np.int16)
    # Dividing for each pixel would take as long as all else.
    columns = np.empty(LARGEST_PX, np.uint32)
    for number in range(len(corners)):
        left, top = max(corners[number, 0], 0), max(corners[number, 1], 0)
        right, bottom = min(corners[number, 2], image.shape[1]), min(corners[number, 3], image.shape[0])
        width, height = right - left, bottom - top
        if not chosen[number] or min(width, height) <= 0 or max(width, height) > LARGEST_PX:
            continue
        inside, total = 0, 0
        for column in range(left, right):
            columns[column - left] = min(column // scale, mask.shape[1] - 1)
        for row in range(top, bottom):
            line = mask[min(row // scale, mask.shape[0] - 1)]
            for column in range(left, right):
                index = (row - top) * width + column - left
                room[index] = -1
                if line[columns[column - left]] > LOWEST_MARK:
                    room[index] = abs(
                        np.int64(image[row, column]) - _ground_at(ground, to_ground, row, column)
                    )
                    inside += 1
                    total += room[index]
        edge = EDGE_SHARE * total / max(inside, 1)
        _outline(room, (left, top, width, height), edge, LEAST_AREA * inside, found[number])
    return found


@compiled
def _ground_at(ground: ByteImage, to_ground: FloatArray, row: int, column: int) -> int:
    """The background at a pixel of the frame, by bilinear interpolation, rounded."""
    height, width = ground.shape
    depth = to_ground[2, 0] * column + to_ground[2, 1] * row + to_ground[2, 2]
    x = (to_ground[0, 0] * column + to_ground[0, 1] * row + to_ground[0, 2]) / depth
    y = (to_ground[1, 0] * column + to_ground[1, 1] * row + to_ground[1, 2]) / depth
    # In this order what is no number becomes 0.
    x, y = min(x if x > 0.0 else 0.0, width - 1.0), min(y if y > 0.0 else 0.0, height - 1.0)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    across, down = x - left, y - top
    upper = ground[top, left] * (1.0 - across) + ground[top, right] * across
    lower = ground[bottom, left] * (1.0 - across) + ground[bottom, right] * across
    return int(np.rint(upper * (1.0 - down) + lower * down))


@compiled
def _outline(
    contrasts: NDArray[np.int16],
    place: tuple[int, int, int, int],
    edge: float,
    least: float,
    found: NDArray[np.float64],
) -> None:
    """Box, centroid and area of what exceeds an edge, unless that is too little."""
    first_x, first_y, width, height = place
    area, sum_x, sum_y = 0, 0, 0
    left, top, right, bottom = first_x + width, first_y + height, first_x, first_y
    for row in range(first_y, first_y + height):
        for column in range(first_x, first_x + width):
            if contrasts[(row - first_y) * width + column - first_x] > edge:
                area, sum_x, sum_y = area + 1, sum_x + column, sum_y + row
                left, top = min(left, column), min(top, row)
                right, bottom = max(right, column + 1), max(bottom, row + 1)
    if area > 0 and area >= least:
        found[0], found[1], found[2], found[3] = left - 0.5, top - 0.5, right - 0.5, bottom - 0.5
        found[4], found[5], found[6] = sum_x / area, sum_y / area, area
