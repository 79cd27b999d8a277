"""Measurement of the foreground of each object."""

from __future__ import annotations

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_differencer.arrays import ByteImage, FloatArray, LabelImage, find_set, has_set
from streamkit_differencer.foreground import MAX_BACKGROUND, MOVING
from streamkit_kernels import INT32, UINT8, compiled, kernel

# Columns of the table of objects.
PIXELS, SUM_X, SUM_Y, LEFT, TOP, RIGHT, BOTTOM, CHANGED, COLUMNS = range(9)


@kernel(UINT8)
def votes(mask: ByteImage) -> ByteImage:
    """The number of set pixels in each two by two, uint8[h / 2, w / 2]; beyond the border none is set."""
    counts = np.zeros(((mask.shape[0] + 1) // 2, (mask.shape[1] + 1) // 2), np.uint8)
    columns = np.empty(mask.shape[1], np.int64)
    for row in range(len(mask)):
        for column in columns[: find_set(mask[row], columns)]:
            counts[row // 2, column // 2] += np.uint8(1)
    return counts


@kernel(UINT8, INT32)
def with_neighbours(cells: ByteImage, labels: LabelImage) -> LabelImage:
    """The labels, where a cell has none with the largest one around it."""
    result, columns = labels.copy(), np.empty(labels.shape[1], np.int64)
    for row in range(len(labels)):
        for column in columns[: find_set(cells[row], columns)]:
            if labels[row, column] == 0:
                near = labels[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
                result[row, column] = near.max()
    return result


@kernel(UINT8, UINT8, INT32, *[types.int64] * 5)
def measure_objects(
    foreground: ByteImage,
    cells: ByteImage,
    labels: LabelImage,
    count: int,
    first_row: int,
    first_column: int,
    step: int,
    min_area: int,
) -> FloatArray:
    """Measures the foreground of each object that is large enough, and clears the rest.

    Args:
        foreground: uint8[h, w], see `foreground`; updated in place.
        cells: uint8[rows, columns], mask.
        labels: int32[rows, columns], the object of a cell, from 1; undefined between cells.
        count: number of objects.
        first_row: of the cells, among those of all of the foreground.
        first_column: the same.
        step: pixels of the foreground per cell.
        min_area: cells that an object must have.

    Returns:
        float64[count, 8] in the order of the labels, in pixels of the foreground: number of pixels, sums of
        their columns and rows, first column and row, last ones, and number of moving pixels; 0 pixels for
        objects that are too small.
    """
    sizes, result = np.zeros(count + 1, np.int64), np.zeros((count, COLUMNS), np.float64)
    columns = np.empty(labels.shape[1], np.int64)
    for row in range(labels.shape[0]):
        for column in columns[: find_set(cells[row], columns)]:
            sizes[labels[row, column]] += 1
    for cell_row in range(labels.shape[0]):
        if not _has_foreground(foreground, (first_row + cell_row) * step, step):
            continue
        for cell_column in range(labels.shape[1]):
            label = labels[cell_row, cell_column]
            if label == 0:
                continue
            top, left = (first_row + cell_row) * step, (first_column + cell_column) * step
            for row in range(top, min(top + step, foreground.shape[0])):
                for column in range(left, min(left + step, foreground.shape[1])):
                    if foreground[row, column] <= MAX_BACKGROUND:
                        continue
                    if sizes[label] >= min_area:
                        _count(result[label - 1], row, column, foreground[row, column] == MOVING)
                    else:
                        foreground[row, column] = 0
    return result


@compiled
def _has_foreground(foreground: ByteImage, first_row: int, count: int) -> bool:
    """Whether some rows have a pixel that is not 0."""
    for row in range(first_row, min(first_row + count, foreground.shape[0])):
        if has_set(foreground[row]):
            return True
    return False


@compiled
def _count(line: NDArray[np.float64], row: int, column: int, is_changed: bool) -> None:
    """Adds a pixel to the row of an object."""
    is_first = line[PIXELS] == 0.0
    line[PIXELS] += 1.0
    line[SUM_X] += column
    line[SUM_Y] += row
    line[LEFT] = column if is_first else min(line[LEFT], column)
    line[TOP] = row if is_first else min(line[TOP], row)
    line[RIGHT], line[BOTTOM] = max(line[RIGHT], column), max(line[BOTTOM], row)
    line[CHANGED] += int(is_changed)
