"""Cells of foreground by vote, and what is measured of the objects that they belong to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import types

from streamkit_differencer.marks import FOREGROUND_CHANGED
from streamkit_kernels import BLOCKS, BYTES, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    ByteLine = NDArray[np.uint8]
    LabelImage = NDArray[np.int32]
    FloatArray = NDArray[np.float64]

# Of a square of two by two pixels, so many make a cell.
VOTES = 2
# Foreground is little: lines are searched for it by pieces of this length.
BLOCK_PX = 64
# Columns of what is measured.
PIXELS, SUM_X, SUM_Y, LEFT, TOP, RIGHT, BOTTOM, CHANGED, COLUMNS = range(9)


@kernel(BYTES, types.int64)
def halved(mask: ByteImage, least: int) -> ByteImage:
    """Sub-samples a mask by the vote of two by two pixels; beyond its border nothing is set.

    Args:
        mask: uint8[h, w].
        least: value from which a pixel counts.

    Returns:
        uint8[(h + 1) // 2, (w + 1) // 2], 255 where at least two pixels do.
    """
    height, width = mask.shape
    cells = np.zeros(((height + 1) // 2, (width + 1) // 2), np.uint8)
    nothing = np.zeros(width, np.uint8)
    for row in range(len(cells)):
        first = mask[2 * row]
        second = mask[2 * row + 1] if 2 * row + 1 < height else nothing
        if _has_something(first) or _has_something(second):
            _vote(first, second, np.uint8(least), cells[row])
    return cells


@compiled
def _has_something(line: ByteLine) -> bool:
    united = np.uint8(0)
    for index in range(line.size):
        united |= line[index]
    return bool(united > 0)


@compiled
def _vote(first: ByteLine, second: ByteLine, least: np.uint8, cells: ByteLine) -> None:
    for index in range(first.size // 2):
        votes = np.uint8(first[2 * index] >= least) + np.uint8(first[2 * index + 1] >= least)
        votes += np.uint8(second[2 * index] >= least) + np.uint8(second[2 * index + 1] >= least)
        cells[index] = np.uint8(255) if votes >= VOTES else np.uint8(0)
    if first.size % 2:
        votes = np.uint8(first[-1] >= least) + np.uint8(second[-1] >= least)
        cells[-1] = np.uint8(255) if votes >= VOTES else np.uint8(0)


@kernel(BYTES, BYTES, BLOCKS, types.int64, types.int64, types.int64, types.int64, types.int64, types.int64)
def measured(
    foreground: ByteImage,
    cells: ByteImage,
    labels: LabelImage,
    count: int,
    first_row: int,
    first_column: int,
    step: int,
    min_area: int,
    least: int,
) -> FloatArray:
    """What the foreground of each object that is large enough measures.

    Args:
        foreground: uint8[h, w], its marks.
        cells: uint8[rows, columns], 255 for cells of the foreground.
        labels: int32[rows, columns], the object that a cell belongs to, from 1, also of those between cells.
        count: of the objects.
        first_row: of the cells, among those of all of the foreground.
        first_column: the same.
        step: pixels of the foreground per cell.
        min_area: cells that an object must have.
        least: mark from which a pixel is foreground.

    Returns:
        float64[count, 8] in the order of their labels, in pixels of the foreground: how many, the sums of
        their columns and rows, the first column and row, the last ones, and how many changed lately; 0 pixels
        for those that are too small.
    """
    height, width = labels.shape
    sizes, result = np.zeros(count + 1, np.int64), np.zeros((count, COLUMNS), np.float64)
    for row in range(height):
        if _has_something(cells[row]):
            _sizes(labels[row], cells[row], sizes)
    left, right = first_column * step, min((first_column + width) * step, foreground.shape[1])
    for row in range(first_row * step, min((first_row + height) * step, foreground.shape[0])):
        for block in range(left, right, BLOCK_PX):
            last = min(block + BLOCK_PX, right)
            if not _has_something(foreground[row, block:last]):
                continue
            for column in range(block, last):
                if foreground[row, column] < least:
                    continue
                label = labels[row // step - first_row, column // step - first_column]
                if label > 0 and sizes[label] >= min_area:
                    _count(result[label - 1], row, column, foreground[row, column] == FOREGROUND_CHANGED)
    return result


@compiled
def _sizes(labels: NDArray[np.int32], cells: ByteLine, sizes: NDArray[np.int64]) -> None:
    """Counts the cells of each object."""
    for index in range(cells.size):
        if cells[index] > 0:
            sizes[labels[index]] += 1


@compiled
def _count(line: NDArray[np.float64], row: int, column: int, is_changed: bool) -> None:
    """Adds a pixel to what an object measures."""
    is_first = line[PIXELS] == 0.0
    line[PIXELS] += 1.0
    line[SUM_X] += column
    line[SUM_Y] += row
    line[LEFT] = column if is_first else min(line[LEFT], column)
    line[TOP] = row if is_first else line[TOP]
    line[RIGHT], line[BOTTOM] = max(line[RIGHT], column), max(line[BOTTOM], row)
    line[CHANGED] += int(is_changed)
