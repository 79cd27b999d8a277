"""Array types and operations. Images are [rows, columns]; masks are uint8, 255 where set unless stated."""

from typing import cast

import cv2
import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_kernels import compiled

ByteImage = NDArray[np.uint8]
CountImage = NDArray[np.uint16]
FloatImage = NDArray[np.float32]
LabelImage = NDArray[np.int32]
Flags = NDArray[np.bool_]
# A row of an image, [columns].
ByteLine = NDArray[np.uint8]
CountLine = NDArray[np.uint16]
FloatLine = NDArray[np.float32]
# Rows or columns of pixels, [n].
Indices = NDArray[np.int64]
# Points [n, 2], boxes [n, 4] and homographies [3, 3].
FloatArray = NDArray[np.float64]
# First column and row of boxes, and those after the last, [n, 4].
Corners = NDArray[np.int64]
CORNERS = types.Array(types.int64, 2, "C")
# First column of each row of a part of the canvas, and the one after the last, [rows, 2].
Spans = NDArray[np.int64]
SPANS = types.Array(types.int64, 2, "C")
# Rows and columns of a part of an image.
Slices = tuple[slice, slice]
# The same for kernels: first row and the one after the last, first column and the one after the last.
Bounds = tuple[int, int, int, int]
BOUNDS = types.UniTuple(types.int64, 4)  # type: ignore[no-untyped-call]
# A line is searched for set pixels by so many columns at a time.
BLOCK = 64


def overlaps(boxes: FloatArray, others: FloatArray) -> Flags:
    """bool[n, m], whether boxes, float64[n, 4] x0 y0 x1 y1, overlap others, float64[m, 4]."""
    left, top, right, bottom = boxes.T[:, :, None]
    first, upper, last, lower = others.T[:, None, :]
    return np.asarray((left < last) & (first < right) & (top < lower) & (upper < bottom))


def above(image: ByteImage, limit: int) -> ByteImage:
    """uint8[h, w], mask of the values above a limit."""
    return cast("ByteImage", cv2.threshold(image, limit, 255, cv2.THRESH_BINARY)[1])


@compiled
def has_set(line: ByteLine) -> bool:
    """Whether a line of a mask has a pixel that is not 0."""
    united = np.uint8(0)
    for index in range(line.size):
        united |= line[index]
    return bool(united > 0)


@compiled
def find_set(line: ByteLine, columns: Indices) -> int:
    """The columns of a line of a mask that are set, of which there are few; returns their number."""
    count = 0
    if not has_set(line):
        return count
    for start in range(0, line.size, BLOCK):
        stop = min(start + BLOCK, line.size)
        if has_set(line[start:stop]):
            for column in range(start, stop):
                if line[column]:
                    columns[count] = column
                    count += 1
    return count
