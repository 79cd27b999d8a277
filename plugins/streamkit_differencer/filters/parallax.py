"""Parallax of tall objects under a moving camera: they shift over the ground against the camera's motion.

A camera at height H that moves by c over the ground sees the top of an object of height h shift by
-c h / (H - h). What shows along its edges lay a little farther along the camera's path before: the object's
own edge on the side that covers ground, and similar ground next to it on the side that uncovers ground. A
vehicle differs from the background there, unless it comes towards the camera no faster than roofs shift: that
is the cost of the filter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_differencer.arrays import ByteImage, ByteLine, Flags, FloatArray, LabelImage
from streamkit_differencer.filters.components import label_blocks
from streamkit_kernels import FLOAT64, INT32, UINT8_1D, UINT8_STRIDED, compiled, kernel

IntegerArray = NDArray[np.int64]
Images = tuple[ByteImage, ByteImage, ByteImage, ByteImage, ByteImage]

# Smaller shifts explain nothing, px.
MIN_SHIFT_PX = 0.3
# The background lags: it shows edges where they were some multiples of tau before; the earlier frame shows
# them where they were one tau before, with a margin in px.
LAG, EARLY_PX = 5.0, 0.5
# Share of a component, or of a block's neighbourhood, that the shift must explain.
EXPLAINED = 0.8
# Blocks to each side of that neighbourhood: that of the edges that a roof covers and uncovers in `LAG` steps.
REACH = 2
# More blocks are sampled.
MAX_BLOCKS = 1000
# What is known of a block.
NOT_SAMPLED, NOT_EXPLAINED, IS_EXPLAINED = 0, 1, 2


def find_parallax(
    images: Images,
    mask: ByteImage,
    blocks: LabelImage,
    count: int,
    shifts: Sequence[FloatArray],
) -> Flags:
    """The blocks of foreground that one of the shifts explains: whole components, and parts of others.

    A roof's edge joins the foreground of a vehicle that drives along it. What would fall into pieces without
    its explained parts is no such vehicle, and stays whole.

    Args:
        images: see `explained_blocks`, up to `thresholds`.
        mask: uint8[h, w], foreground.
        blocks: int32[n, 3], its components, see `components_of`.
        count: number of components.
        shifts: see `explained_blocks`, of each block.

    Returns:
        bool[n].
    """
    found, shape = np.zeros(len(blocks), np.bool_), (mask.shape[0] // 2, mask.shape[1] // 2)
    for shift in shifts:
        states = explained_blocks(*images, mask, blocks, shift)
        is_whole, is_part = count_votes(blocks, states, count, *shape)
        if (is_part & ~is_whole).any():
            is_part &= _pieces(blocks, ~is_part, mask.shape[1])[blocks[:, 2]] <= 1
        found |= is_whole | is_part
    return found


@kernel(INT32, UINT8_1D, types.int64, types.int64, types.int64)
def count_votes(
    blocks: LabelImage, states: ByteLine, count: int, height: int, width: int
) -> tuple[Flags, Flags]:
    """The blocks of which the shift explains enough of the component, or of the neighbourhood.

    Args:
        blocks: int32[n, 3], see `components_of`.
        states: uint8[n], see `explained_blocks`.
        count: number of components.
        height: of the mask, blocks.
        width: of the mask, blocks.

    Returns:
        bool[n] each.
    """
    sampled, agreeing = np.zeros(count, np.int64), np.zeros(count, np.int64)
    grid = np.zeros((height, width), np.uint8)
    for index in range(len(blocks)):
        sampled[blocks[index, 2]] += states[index] != NOT_SAMPLED
        agreeing[blocks[index, 2]] += states[index] == IS_EXPLAINED
        grid[blocks[index, 0] // 2, blocks[index, 1] // 2] = states[index]
    is_whole, is_part = np.empty(len(blocks), np.bool_), np.empty(len(blocks), np.bool_)
    for index in range(len(blocks)):
        component = blocks[index, 2]
        is_whole[index] = agreeing[component] >= EXPLAINED * max(sampled[component], 1)
        row, column = blocks[index, 0] // 2, blocks[index, 1] // 2
        near = grid[max(row - REACH, 0) : row + REACH + 1, max(column - REACH, 0) : column + REACH + 1]
        votes = 0, 0
        for state in near.flat:
            votes = votes[0] + (state != NOT_SAMPLED), votes[1] + (state == IS_EXPLAINED)
        is_part[index] = votes[1] >= EXPLAINED * max(votes[0], 1)
    return is_whole, is_part


def _pieces(blocks: LabelImage, stays: Flags, width: int) -> IntegerArray:
    """The number of connected pieces into which each component falls, int64[components]."""
    kept = blocks[stays]
    pieces = kept.copy()
    owners = np.empty(label_blocks(pieces, width), np.int64)
    owners[pieces[:, 2]] = kept[:, 2]
    return np.bincount(owners, minlength=blocks[:, 2].max() + 1)


@kernel(*[UINT8_STRIDED] * 6, INT32, FLOAT64)
def explained_blocks(
    image: ByteImage,
    background: ByteImage,
    valid: ByteImage,
    earlier: ByteImage,
    thresholds: ByteImage,
    mask: ByteImage,
    blocks: LabelImage,
    shifts: FloatArray,
) -> ByteImage:
    """Whether the shift explains blocks of foreground, both by the background and by the earlier frame.

    The background alone may explain a vehicle that was learnt, the frame alone a slow one.

    Args:
        image: uint8[h, w], f(t), as all images.
        background: uint8[h, w], B(t - 1), rounded.
        valid: uint8[h, w], mask of where it is known.
        earlier: uint8[h, w], f(t - tau), `UNSEEN` where it shows nothing.
        thresholds: uint8[h, w], T_F of each pixel, grey levels.
        mask: uint8[h, w], foreground.
        blocks: int32[n, 3], see `components_of`.
        shifts: float64[n, 2], px, of each block the vector to where it may have shifted from in the last tau
            frames.

    Returns:
        uint8[n], `NOT_SAMPLED`, `NOT_EXPLAINED` or `IS_EXPLAINED`.
    """
    states = np.zeros(len(blocks), np.uint8)
    for index in range(0, len(blocks), max(1, -(-len(blocks) // MAX_BLOCKS))):
        row, column = blocks[index, 0], blocks[index, 1]
        # The diagonal corner where this one is not in the mask; blocks with neither are skipped.
        other = int(mask[row, column] == 0)
        row, column = row + other, column + other
        if mask[row, column] == 0:
            continue
        states[index] = NOT_EXPLAINED
        # Signed, as bounds may be below zero.
        value, most = np.int64(image[row, column]), np.int64(thresholds[row, column])
        low, high = value - most, value + most
        shift_x, shift_y = shifts[index, 0], shifts[index, 1]
        length = np.sqrt(shift_x * shift_x + shift_y * shift_y)
        if not length >= MIN_SHIFT_PX:  # or no number
            continue
        path = LAG * shift_x, LAG * shift_y
        if _explains(background, valid, row, column, path, low, high):
            beyond = 1.0 + EARLY_PX / length
            path = beyond * shift_x, beyond * shift_y
            if _explains(earlier, earlier, row, column, path, low, high):
                states[index] = IS_EXPLAINED
    return states


@compiled
def _explains(
    image: ByteImage,
    known: ByteImage,
    row: int,
    column: int,
    path: tuple[float, float],
    low: np.int64,
    high: np.int64,
) -> bool:
    """Whether the range of values along a known path and next to it overlaps `low` to `high`."""
    bottom, right = image.shape[0] - 1, image.shape[1] - 1
    steps = int(np.rint(max(abs(path[0]), abs(path[1]))))
    lowest, highest = np.int64(255), np.int64(0)
    for step in range(steps + 1):
        part = step / max(steps, 1)
        y = min(max(row + int(np.rint(part * path[1])), 0), bottom)
        x = min(max(column + int(np.rint(part * path[0])), 0), right)
        if known[y, x] == 0:
            continue
        # A loop over the columns, too, takes twice as long.
        for line in (max(y - 1, 0), y, min(y + 1, bottom)):
            before, value = np.int64(image[line, max(x - 1, 0)]), np.int64(image[line, x])
            after = np.int64(image[line, min(x + 1, right)])
            lowest, highest = min(lowest, before, value, after), max(highest, before, value, after)
        if lowest <= high and highest >= low:
            return True
    return False
