"""The foreground mask as it is output: the whole of what moves, without its halo.

Objects are detected in foreground that hysteresis and blurred working pixels widen by a pixel, and the middle
of a slow object may look as it did some frames before.
"""

from __future__ import annotations

import numpy as np

from streamkit_differencer.arrays import CORNERS, ByteImage, Corners, Flags, FloatArray
from streamkit_differencer.mask_values import HIGHEST_BACKGROUND, MOVING
from streamkit_differencer.objects import Objects
from streamkit_differencer.refinement import background_at
from streamkit_kernels import BYTES, FLAGS, TABLE, VIEW, compiled, kernel

# An object of which this share changed moves as a whole.
LEAST_CHANGE = 0.5
# Edge pixels with less than this share of an object's mean contrast are background. Half-covered pixels have
# more; parts of an object that are almost as grey as the background may have less.
LEAST_SHARE = 0.12
# Marks removed pixels until an object is finished.
TRIMMED = 1


def refine_mask(
    mask: ByteImage,
    objects: Objects,
    image: ByteImage,
    background: ByteImage,
    to_background: FloatArray,
    scale: int,
    has_halo: bool,
) -> None:
    """Marks moving objects as a whole, and removes their halo.

    Args:
        mask: uint8[h, w], the frame's foreground at the working scale; updated in place.
        objects: what was found in it, as measured on it.
        image: uint8[h, w], the frame at the working scale.
        background: uint8.
        to_background: float64[3, 3], working pixels to those of `background`.
        scale: frame pixels per working pixel.
        has_halo: whether the foreground was grown.
    """
    if not len(objects):
        return
    height, width = mask.shape
    corners = np.rint((objects.boxes + 0.5) / scale).astype(np.int64)
    corners = np.clip(corners, 0, [width, height, width, height])
    mark_moving(mask, corners, objects.changes >= LEAST_CHANGE)
    if has_halo:
        trim_halo(mask, image, background, to_background, corners)


@kernel(BYTES, CORNERS, FLAGS)
def mark_moving(mask: ByteImage, corners: Corners, moves: Flags) -> None:
    """Marks the foreground in some boxes as moving.

    Args:
        mask: uint8[h, w], foreground; updated in place.
        corners: int64[n, 4], first column and row of each box, and those after the last.
        moves: bool[n], mask of the boxes.
    """
    for number in range(len(corners)):
        if moves[number]:
            left, top, right, bottom = corners[number]
            for row in range(top, bottom):
                line = mask[row, left:right]
                for index in range(line.size):
                    is_foreground = line[index] > np.uint8(HIGHEST_BACKGROUND)
                    line[index] = np.uint8(MOVING) if is_foreground else line[index]


@kernel(BYTES, VIEW, VIEW, TABLE, CORNERS)
def trim_halo(
    mask: ByteImage, image: ByteImage, background: ByteImage, to_background: FloatArray, corners: Corners
) -> None:
    """Removes pixels at the edges of the foreground in some boxes that hardly differ from the background.

    Args:
        mask: uint8[h, w], foreground; updated in place.
        image: uint8[h, w], the frame at the same scale.
        background: uint8, its border is replicated.
        to_background: float64[3, 3], frame pixels to those of `background`.
        corners: int64[n, 4], first column and row of each box, and those after the last.
    """
    contrasts = np.empty(mask.shape, np.uint8)
    for number in range(len(corners)):
        left, top, right, bottom = corners[number]
        inside, total = 0, 0
        for row in range(top, bottom):
            for column in range(left, right):
                if mask[row, column] > HIGHEST_BACKGROUND:
                    value = abs(
                        int(image[row, column]) - background_at(background, to_background, row, column)
                    )
                    contrasts[row, column] = value
                    inside, total = inside + 1, total + value
        least = LEAST_SHARE * total / max(inside, 1)
        for row in range(top, bottom):
            for column in range(left, right):
                is_foreground = mask[row, column] > HIGHEST_BACKGROUND
                if is_foreground and contrasts[row, column] < least and _is_edge(mask, row, column):
                    mask[row, column] = TRIMMED
        for row in range(top, bottom):
            line = mask[row, left:right]
            for index in range(line.size):
                line[index] = np.uint8(0) if line[index] == np.uint8(TRIMMED) else line[index]


@compiled
def _is_edge(mask: ByteImage, row: int, column: int) -> bool:
    """Whether one of four neighbours is background; the border is replicated."""
    height, width = mask.shape
    return bool(
        _is_background(mask[max(row - 1, 0), column])
        or _is_background(mask[min(row + 1, height - 1), column])
        or _is_background(mask[row, max(column - 1, 0)])
        or _is_background(mask[row, min(column + 1, width - 1)])
    )


@compiled
def _is_background(mark: np.uint8) -> bool:
    return bool(mark <= np.uint8(HIGHEST_BACKGROUND) and mark != np.uint8(TRIMMED))
