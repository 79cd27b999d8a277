"""The parts of a frame that windows lie in, laid out so that a sample between pixels is read at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streamkit_tracker.compiled import compiled
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray

Float32Array = NDArray[np.float32]
ByteArray = NDArray[np.uint8]
IntArray = NDArray[np.int64]
LevelArray = NDArray[np.uint16]

MIDDLE_GREY = np.float32(128.0)  # keeps sums of squares small, so that float32 is enough for the variance
LEFT, TOP, ACROSS, DOWN, START = range(5)


@dataclass(frozen=True, eq=False)
class Crops:
    """Parts of a frame, one for each of g groups of windows.

    Attributes:
        quads: int64[total], part after part, row after row: the grey levels of a pixel, the one right of it,
            the one below and the one below right, in 256ths, 16 bits each from the lowest to the highest.
            What is beyond a part is as its edge.
        places: int64[g, 5]: left and top pixel of each part in the frame, its width and height in quads, and
            the index of its first quad.
        factor: by how much the frame was averaged down.
    """

    quads: IntArray
    places: IntArray
    factor: int


class FrameCrops:
    """Cuts the parts out of one frame after another."""

    def __init__(self) -> None:
        self.image: ByteArray = np.zeros((1, 1), np.uint8)

    def look_at(self, image: ByteArray) -> None:
        """Takes the next frame, uint8[h, w]."""
        self.image = image

    def around(self, windows: FloatArray, groups: int, factor: int, margin: float = 0.0) -> Crops:
        """The parts around `groups` runs of equal length of the windows float64[n, 5].

        Args:
            windows: finite.
            groups: divides n.
            factor: by how much the frame is averaged down; a rest at the parts' far edges goes.
            margin: room for windows that come later, relative to the diagonal of the largest.
        """
        height, width = self.image.shape
        places = np.empty((groups, 5), np.int64)
        total = _place(np.ascontiguousarray(windows), height, width, factor, margin, places)
        levels = np.empty(total * factor**2, np.uint8)
        begin = 0
        # copied here, so that the compiled part sees one kind of array whatever the frame's memory is like
        for left, top, across, down, _ in places.tolist():
            rows, columns = down * factor, across * factor
            end = begin + rows * columns
            part = self.image[top : top + rows, left : left + columns]
            levels[begin:end].reshape(rows, columns)[...] = part
            begin = end
        quads = np.empty(total, np.int64)
        _pack(levels, places, factor, quads)
        return Crops(quads, places, factor)


@compiled
def _place(windows: FloatArray, height: int, width: int, factor: int, margin: float, places: IntArray) -> int:
    """Fills in where the parts lie; gives the number of all their quads."""
    each = len(windows) // len(places)
    total = 0
    for group in range(len(places)):
        low_x, low_y, high_x, high_y, length, across = np.inf, np.inf, -np.inf, -np.inf, 0.0, 0.0
        for index in range(group * each, (group + 1) * each):
            window = windows[index]
            low_x, high_x = min(low_x, window[0]), max(high_x, window[0])
            low_y, high_y = min(low_y, window[1]), max(high_y, window[1])
            length, across = max(length, window[LENGTH]), max(across, window[WIDTH])
        reach = (0.5 + margin) * np.hypot(length, across)
        left, right = _span(low_x - reach, high_x + reach, width, factor)
        top, bottom = _span(low_y - reach, high_y + reach, height, factor)
        places[group, LEFT], places[group, TOP] = left, top
        places[group, ACROSS], places[group, DOWN] = (right - left) // factor, (bottom - top) // factor
        places[group, START] = total
        total += places[group, ACROSS] * places[group, DOWN]
    return total


@compiled
def _span(low: float, high: float, size: int, factor: int) -> tuple[int, int]:
    """Where a part around low and high begins and ends along one side of the frame.

    It begins at a multiple of the factor, so that a place is averaged with the same neighbours in every part.
    """
    start = int(min(max(low - 2, 0.0), max(size - factor, 0))) // factor * factor
    return start, int(min(max(high + 3 + factor, start + factor), max(size, factor)))


@compiled
def _pack(levels: ByteArray, places: IntArray, factor: int, quads: IntArray) -> None:
    """Averages the parts, `levels` one after another, over squares of `factor` pixels and packs them."""
    begin = 0
    for group in range(len(places)):
        across, down = places[group, ACROSS], places[group, DOWN]
        end = begin + across * down * factor**2
        part = _shrunk(levels[begin:end].reshape(down * factor, across * factor), factor)
        begin = end
        start = places[group, START]
        for row in range(down):
            upper, lower = part[row], part[min(row + 1, down - 1)]
            line = quads[start + row * across : start + (row + 1) * across]
            for column in range(across):
                line[column] = np.int64(upper[column]) | (np.int64(lower[column]) << 32)
            for column in range(across - 1):
                line[column] |= (np.int64(upper[column + 1]) << 16) | (np.int64(lower[column + 1]) << 48)
            line[across - 1] |= line[across - 1] << 16


@compiled
def _shrunk(part: ByteArray, factor: int) -> LevelArray:
    """uint16 averages over squares of `factor` pixels, which divides both sides, in 256ths."""
    down, across = part.shape[0] // factor, part.shape[1] // factor
    result = np.empty((down, across), np.uint16)
    sums = np.empty(across * factor, np.int32)
    area = factor * factor
    for row in range(down):
        if factor == 1:
            for column in range(across):
                result[row, column] = np.uint16(part[row, column]) << 8
            continue
        sums[:] = 0
        for step in range(factor):
            line = part[row * factor + step]
            for column in range(len(line)):
                sums[column] += line[column]
        for column in range(across):
            total = 0
            for step in range(factor):
                total += sums[column * factor + step]
            result[row, column] = (256 * total + area // 2) // area
    return result
