"""Parts of a frame, packed so that the four pixels around a sample are read at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_kernels import UINT8_STRIDED, compiled, kernel
from streamkit_tracker.window_geometry import LENGTH, WIDTH, ByteArray, FloatArray, IntArray

QuadArray = NDArray[np.int32]

MIDDLE_GREY = np.float32(128.0)  # keeps sums of squares small, so that float32 is enough for the variance
LEFT, TOP, ACROSS, DOWN, START = range(5)
PLACES, QUADS = types.Array(types.int64, 2, "C"), types.Array(types.int32, 1, "C")


@dataclass(frozen=True, eq=False)
class Crops:
    """Parts of a frame, one for each of g groups of windows.

    Attributes:
        quads: int32[total], part after part, row after row: the grey levels of a pixel, the one right of it,
            the one below and the one below right, from the lowest byte to the highest. What is beyond a
            part is as its edge.
        parts: int64[g, 5]: left and top pixel of each part in the frame, its width and height in quads, and
            the index of its first quad.
        factor: by how much the frame was averaged down.
    """

    quads: QuadArray
    parts: IntArray
    factor: int


@compiled
def lay_out_parts(
    windows: FloatArray, height: int, width: int, factor: int, margin: float, parts: IntArray
) -> int:
    """Fills in the parts around equal runs of windows; returns the number of quads."""
    each = len(windows) // len(parts)
    total = 0
    for group in range(len(parts)):
        low_x, low_y, high_x, high_y, length, across = np.inf, np.inf, -np.inf, -np.inf, 0.0, 0.0
        for index in range(group * each, (group + 1) * each):
            window = windows[index]
            low_x, high_x = min(low_x, window[0]), max(high_x, window[0])
            low_y, high_y = min(low_y, window[1]), max(high_y, window[1])
            length, across = max(length, window[LENGTH]), max(across, window[WIDTH])
        reach = (0.5 + margin) * np.hypot(length, across)
        left, right = _span(low_x - reach, high_x + reach, width, factor)
        top, bottom = _span(low_y - reach, high_y + reach, height, factor)
        parts[group, LEFT], parts[group, TOP] = left, top
        parts[group, ACROSS], parts[group, DOWN] = (right - left) // factor, (bottom - top) // factor
        parts[group, START] = total
        total += parts[group, ACROSS] * parts[group, DOWN]
    return total


@compiled
def _span(low: float, high: float, size: int, factor: int) -> tuple[int, int]:
    """Where a part around low and high begins and ends along one side of the frame.

    It begins at a multiple of the factor, so that a pixel is averaged with the same neighbours in every part.
    """
    start = int(min(max(low - 2, 0.0), max(size - factor, 0))) // factor * factor
    return start, int(min(max(high + 3 + factor, start + factor), max(size, factor)))


@kernel(UINT8_STRIDED, PLACES, QUADS)
def pack_parts(image: ByteArray, parts: IntArray, quads: QuadArray) -> None:
    """Packs parts of an image.

    Args:
        image: uint8[h, w], whatever its memory is like.
        parts: int64[g, 5], see `Crops`, in pixels of this image.
        quads: int32[total], is filled.
    """
    for group in range(len(parts)):
        left, top, across, down, start = parts[group]
        for row in range(down):
            upper = image[top + row, left : left + across]
            lower = image[top + min(row + 1, down - 1), left : left + across]
            line = quads[start + row * across : start + (row + 1) * across]
            for column in range(across):
                line[column] = np.int32(np.int32(upper[column]) | np.int32(np.int32(lower[column]) << 16))
            # each column takes its neighbour's bytes before that one takes others
            for column in range(across - 1):
                line[column] = np.int32(line[column] | np.int32(line[column + 1] << np.int32(8)))
            line[across - 1] = np.int32(line[across - 1] | np.int32(line[across - 1] << np.int32(8)))
