"""Cells of foreground by vote, and measurement of the objects that they belong to."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_differencer.arrays import ByteImage, FloatArray, LabelImage
from streamkit_differencer.mask_values import MOVING
from streamkit_kernels import INT32, UINT8, compiled, kernel

# Columns of the table of objects.
PIXELS, SUM_X, SUM_Y, LEFT, TOP, RIGHT, BOTTOM, CHANGED, COLUMNS = range(9)


def downsampled_by_vote(mask: ByteImage, least: int) -> ByteImage:
    """Sub-samples a mask by the vote of two by two pixels; 0 beyond its border.

    Args:
        mask: uint8[h, w].
        least: smallest value that counts as set.

    Returns:
        uint8[(h + 1) // 2, (w + 1) // 2], 255 where at least two pixels are set.
    """
    height, width = mask.shape
    whole = cv2.threshold(mask, least - 1, 255, cv2.THRESH_BINARY)[1]
    if height % 2 or width % 2:
        whole = cv2.copyMakeBorder(whole, 0, height % 2, 0, width % 2, cv2.BORDER_CONSTANT, value=0)
    means = cv2.resize(whole, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
    # The mean of two set pixels of four is 128.
    return cast("ByteImage", cv2.threshold(means, 127, 255, cv2.THRESH_BINARY)[1])


@kernel(UINT8, UINT8, INT32, types.int64, types.int64, types.int64, types.int64, types.int64, types.int64)
def measure_objects(
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
    """Measures the foreground of each object that is large enough, and clears the rest.

    Args:
        foreground: uint8[h, w], see `mask_values`; updated in place.
        cells: uint8[rows, columns], mask.
        labels: int32[rows, columns], the object of a cell, from 1; undefined between cells.
        count: number of objects.
        first_row: of the cells, among those of all of the foreground.
        first_column: the same.
        step: pixels of the foreground per cell.
        min_area: cells that an object must have.
        least: smallest value of foreground.

    Returns:
        float64[count, 8] in the order of the labels, in pixels of the foreground: number of pixels, sums of
        their columns and rows, first column and row, last ones, and number of moving pixels; 0 pixels for
        objects that are too small.
    """
    sizes, result = np.zeros(count + 1, np.int64), np.zeros((count, COLUMNS), np.float64)
    for row in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            if cells[row, column] > 0:
                sizes[labels[row, column]] += 1
    for cell_row in range(labels.shape[0]):
        for cell_column in range(labels.shape[1]):
            label = labels[cell_row, cell_column]
            if label == 0:
                continue
            top, left = (first_row + cell_row) * step, (first_column + cell_column) * step
            for row in range(top, min(top + step, foreground.shape[0])):
                for column in range(left, min(left + step, foreground.shape[1])):
                    if foreground[row, column] < least:
                        continue
                    if sizes[label] >= min_area:
                        _count(result[label - 1], row, column, foreground[row, column] == MOVING)
                    else:
                        foreground[row, column] = 0
    return result


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
