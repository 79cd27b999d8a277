"""The foreground as it is shown: all of what moves, and no more than that.

Objects are sought in foreground that is judged with blurred pictures and grown through whatever differs
a little: it is a pixel wider than a thing. And the middle of a slow thing may look as it did frames before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import types

from streamkit_differencer.marks import FOREGROUND_CHANGED
from streamkit_differencer.objects import LOWEST_MARK
from streamkit_kernels import BYTES, FLAGS, TABLE, VIEW, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.objects import Objects

    ByteImage = NDArray[np.uint8]
    FloatArray = NDArray[np.float64]
    Corners = NDArray[np.int64]
    Flags = NDArray[np.bool_]

# Of what so much changed lately, all moves.
MOST_CHANGED = 0.5
# At the edge of a thing, what has less than this share of its mean contrast is ground. What a thing covers by
# half has more, but a thing may be almost as grey as the ground in places.
LEAST_SHARE = 0.12
# What was taken away, until all of a thing is.
TRIMMED = 1


def show_movers(
    mask: ByteImage,
    objects: Objects,
    image: ByteImage,
    ground: ByteImage,
    to_ground: FloatArray,
    scale: int,
    has_halo: bool,
) -> None:
    """Marks all of what moves as moving, and takes its halo away.

    Args:
        mask: uint8[h, w], the frame's foreground at the working scale; updated in place.
        objects: what was found in it, as measured on it.
        image: uint8[h, w], the frame at the working scale.
        ground: uint8, the background.
        to_ground: float64[3, 3], working pixels to those of `ground`.
        scale: frame pixels per working pixel.
        has_halo: whether the foreground was grown.
    """
    if not len(objects):
        return
    height, width = mask.shape
    corners = np.rint((objects.boxes + 0.5) / scale).astype(np.int64)
    corners = np.clip(corners, 0, [width, height, width, height])
    mark_all(mask, corners, objects.scores >= MOST_CHANGED)
    if has_halo:
        take_halo(mask, image, ground, to_ground, corners)


@kernel(BYTES, types.Array(types.int64, 2, "C"), FLAGS)
def mark_all(mask: ByteImage, corners: Corners, moves: Flags) -> None:
    """Marks the foreground in some boxes as changed.

    Args:
        mask: uint8[h, w], foreground; updated in place.
        corners: int64[n, 4], first column and row of each box, and those after the last.
        moves: bool[n], in which boxes.
    """
    for number in range(len(corners)):
        if moves[number]:
            left, top, right, bottom = corners[number]
            for row in range(top, bottom):
                line = mask[row, left:right]
                for index in range(line.size):
                    is_thing = line[index] > np.uint8(LOWEST_MARK)
                    line[index] = np.uint8(FOREGROUND_CHANGED) if is_thing else line[index]


@kernel(BYTES, VIEW, VIEW, TABLE, types.Array(types.int64, 2, "C"))
def take_halo(
    mask: ByteImage, image: ByteImage, ground: ByteImage, to_ground: FloatArray, corners: Corners
) -> None:
    """Takes away what hardly differs from the ground at the edges of the foreground in some boxes.

    Args:
        mask: uint8[h, w], foreground; updated in place.
        image: uint8[h, w], the frame at the same scale.
        ground: uint8, the background; beyond its border it goes on as on it.
        to_ground: float64[3, 3], pixels of the frame to those of `ground`.
        corners: int64[n, 4], first column and row of each box, and those after the last.
    """
    contrasts = np.empty(mask.shape, np.uint8)
    for number in range(len(corners)):
        left, top, right, bottom = corners[number]
        inside, total = 0, 0
        for row in range(top, bottom):
            for column in range(left, right):
                if mask[row, column] > LOWEST_MARK:
                    value = abs(int(image[row, column]) - _ground_at(ground, to_ground, row, column))
                    contrasts[row, column] = value
                    inside, total = inside + 1, total + value
        least = LEAST_SHARE * total / max(inside, 1)
        for row in range(top, bottom):
            for column in range(left, right):
                is_thing = mask[row, column] > LOWEST_MARK
                if is_thing and contrasts[row, column] < least and _is_edge(mask, row, column):
                    mask[row, column] = TRIMMED
        for row in range(top, bottom):
            line = mask[row, left:right]
            for index in range(line.size):
                line[index] = np.uint8(0) if line[index] == np.uint8(TRIMMED) else line[index]


@compiled
def _is_edge(mask: ByteImage, row: int, column: int) -> bool:
    """Whether one of four neighbours was no foreground; beyond the picture it goes on as at its border."""
    height, width = mask.shape
    return bool(
        _is_ground(mask[max(row - 1, 0), column])
        or _is_ground(mask[min(row + 1, height - 1), column])
        or _is_ground(mask[row, max(column - 1, 0)])
        or _is_ground(mask[row, min(column + 1, width - 1)])
    )


@compiled
def _is_ground(mark: np.uint8) -> bool:
    return bool(mark <= np.uint8(LOWEST_MARK) and mark != np.uint8(TRIMMED))


@compiled
def _ground_at(ground: ByteImage, to_ground: FloatArray, row: int, column: int) -> int:
    """The background at a pixel of the frame, by bilinear interpolation, rounded."""
    height, width = ground.shape
    depth = 1.0 / (to_ground[2, 0] * column + to_ground[2, 1] * row + to_ground[2, 2])
    x = (to_ground[0, 0] * column + to_ground[0, 1] * row + to_ground[0, 2]) * depth
    y = (to_ground[1, 0] * column + to_ground[1, 1] * row + to_ground[1, 2]) * depth
    # In this order what is no number becomes 0.
    x, y = min(x if x > 0.0 else 0.0, width - 1.0), min(y if y > 0.0 else 0.0, height - 1.0)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    across, down = x - left, y - top
    upper = ground[top, left] * (1.0 - across) + ground[top, right] * across
    lower = ground[bottom, left] * (1.0 - across) + ground[bottom, right] * across
    return int(upper * (1.0 - down) + lower * down + 0.5)
