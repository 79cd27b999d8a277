"""Foreground without lone pixels, grown to the whole of things: thresholding with hysteresis.

A tolerance of registration hides the grey parts of a thing. What is next to its clear parts and differs from
the background by a share of the threshold belongs to it.

Source: thresholding with hysteresis, Canny, "A Computational Approach to Edge Detection", PAMI 1986.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from streamkit_differencer.canvas_region import REGION
from streamkit_differencer.contrast import GROUND, STRONG, WEAK
from streamkit_kernels import BYTES, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    ByteLine = NDArray[np.uint8]

# Growth takes so many steps of so many pixels.
STEP_PX = 2
MAJORITY = 5
# Rows and columns of what is looked at together.
BLOCK_ROWS, BLOCK_PX = 16, 64


@kernel(BYTES, BYTES, REGION)
def strong(levels: ByteImage, mask: ByteImage, region: Region) -> None:
    """The pixels that are foreground by themselves.

    Args:
        levels: uint8[h, w], see `contrast.judge`.
        mask: uint8[h, w], becomes the mask of those.
        region: of both.
    """
    top, bottom, left, right = region
    for row in range(top, bottom):
        _strong(levels[row, left:right], mask[row, left:right])


@kernel(BYTES, BYTES, BYTES, REGION)
def grow(levels: ByteImage, room: ByteImage, mask: ByteImage, region: Region) -> None:
    """The foreground without lone pixels, grown by up to two steps of two pixels through what is weak.

    Args:
        levels: uint8[h, w], see `contrast.judge`; what a majority of neighbours fills becomes weak.
        room: uint8[h, w], to work in.
        mask: uint8[h, w], becomes the foreground, within the region.
        region: of all three.
    """
    top, bottom, left, right = region
    _clear(mask, region)
    _clear(room, region)
    united = np.zeros(right - left + 2 * STEP_PX, np.uint8)
    inner = united[STEP_PX : STEP_PX + right - left]
    # Foreground is little: only blocks near some of it are looked at.
    for first in range(top, bottom, BLOCK_ROWS):
        last = min(first + BLOCK_ROWS, bottom)
        _empty(inner)
        for row in range(max(first - 1, top), min(last + 1, bottom)):
            _unite_strong(levels[row, left:right], inner)
        for start in range(left, right, BLOCK_PX):
            stop = min(start + BLOCK_PX, right)
            if _has_something(united[start - left + STEP_PX - 1 : stop - left + STEP_PX + 1]):
                _vote(levels, mask, (first, last, start, stop), region)
    _step(mask, levels, room, region, united)
    _clear(mask, region)
    _step(room, levels, mask, region, united)


@compiled
def _strong(level: ByteLine, line: ByteLine) -> None:
    for index in range(line.size):
        line[index] = np.uint8(255) if level[index] == np.uint8(STRONG) else np.uint8(0)


@compiled
def _clear(mask: ByteImage, region: Region) -> None:
    top, bottom, left, right = region
    for row in range(top, bottom):
        _empty(mask[row, left:right])


@compiled
def _empty(line: ByteLine) -> None:
    for index in range(line.size):
        line[index] = 0


@compiled
def _unite_strong(level: ByteLine, united: ByteLine) -> None:
    for index in range(united.size):
        united[index] |= np.uint8(255) if level[index] == np.uint8(STRONG) else np.uint8(0)


@compiled
def _unite(other: ByteLine, line: ByteLine) -> None:
    for index in range(line.size):
        line[index] |= other[index]


@compiled
def _has_something(line: ByteLine) -> bool:
    united = np.uint8(0)
    for index in range(line.size):
        united |= line[index]
    return bool(united > 0)


@compiled
def _vote(levels: ByteImage, mask: ByteImage, block: Region, region: Region) -> None:
    """The median of a block's squares of three by three; beyond the region it goes on as at its border.

    What is known and lies among foreground may be grown into.
    """
    top, bottom, left, right = region
    first, last, start, stop = block
    sums = np.empty(stop - start + 2, np.uint8)
    low, high = max(start - 1, left), min(stop + 1, right)
    width, level, thing = levels.shape[1], levels.reshape(-1), mask.reshape(-1)
    for row in range(first, last):
        above, below = max(row - 1, top) * width + low, min(row + 1, bottom - 1) * width + low
        _count(level, above, row * width + low, below, low - start + 1, high - low, sums)
        if low == start:
            sums[0] = sums[1]
        if high == stop:
            sums[stop - start + 1] = sums[stop - start]
        _elect(sums, row * width + start, stop - start, thing, level)


# Lines are named by where they begin: a view of each would cost as much as what is done with it.
@compiled
def _count(
    level: ByteLine, above: int, here: int, below: int, first: int, count: int, sums: ByteLine
) -> None:
    """How many of three pixels are strong, from `first` on."""
    strong, one, none = np.uint8(STRONG), np.uint8(1), np.uint8(0)
    over, middle, under, begin = np.uintp(above), np.uintp(here), np.uintp(below), np.uintp(first)
    for index in range(count):
        step = np.uintp(index)
        total = one if level[np.uintp(over + step)] == strong else none
        total = np.uint8(total + (one if level[np.uintp(middle + step)] == strong else none))
        total = np.uint8(total + (one if level[np.uintp(under + step)] == strong else none))
        sums[np.uintp(begin + step)] = total


@compiled
def _elect(sums: ByteLine, place: int, count: int, thing: ByteLine, level: ByteLine) -> None:
    begin, one, two = np.uintp(place), np.uintp(1), np.uintp(2)
    for index in range(count):
        step = np.uintp(index)
        votes = np.uint8(np.uint8(sums[step] + sums[np.uintp(step + one)]) + sums[np.uintp(step + two)])
        pixel, is_thing = np.uintp(begin + step), votes >= np.uint8(MAJORITY)
        thing[pixel] = np.uint8(255) if is_thing else np.uint8(0)
        level[pixel] = np.uint8(WEAK) if is_thing and level[pixel] == np.uint8(GROUND) else level[pixel]


@compiled
def _step(source: ByteImage, levels: ByteImage, target: ByteImage, region: Region, united: ByteLine) -> None:
    """Grows the foreground by `STEP_PX` in each direction, where that is weak; the target is empty."""
    top, bottom, left, right = region
    inner = united[STEP_PX : STEP_PX + right - left]
    for first in range(top, bottom, BLOCK_ROWS):
        last = min(first + BLOCK_ROWS, bottom)
        _empty(inner)
        for row in range(max(first - STEP_PX, top), min(last + STEP_PX, bottom)):
            _unite(source[row, left:right], inner)
        for start in range(left, right, BLOCK_PX):
            stop = min(start + BLOCK_PX, right)
            if _has_something(united[start - left : stop - left + 2 * STEP_PX]):
                _spread(source, levels, target, (first, last, start, stop), region)


@compiled
def _spread(source: ByteImage, levels: ByteImage, target: ByteImage, block: Region, region: Region) -> None:
    top, bottom, left, right = region
    first, last, start, stop = block
    column = np.zeros(stop - start + 2 * STEP_PX, np.uint8)
    low, high = max(start - STEP_PX, left), min(stop + STEP_PX, right)
    width, thing, level, line = levels.shape[1], source.reshape(-1), levels.reshape(-1), target.reshape(-1)
    for row in range(first, last):
        for index in range(column.size):
            column[index] = 0
        for other in range(max(row - STEP_PX, top), min(row + STEP_PX + 1, bottom)):
            _unite_line(thing, other * width + low, low - start + STEP_PX, high - low, column)
        _unite_columns(column, row * width + start, stop - start, level, line)


@compiled
def _unite_line(thing: ByteLine, place: int, first: int, count: int, column: ByteLine) -> None:
    here, begin = np.uintp(place), np.uintp(first)
    for index in range(count):
        column[np.uintp(begin + np.uintp(index))] |= thing[np.uintp(here + np.uintp(index))]


@compiled
def _unite_columns(column: ByteLine, place: int, count: int, level: ByteLine, line: ByteLine) -> None:
    """Of five pixels of a column each, where that is weak."""
    here = np.uintp(place)
    for index in range(count):
        near = np.uint8(0)
        for step in range(2 * STEP_PX + 1):
            near |= column[np.uintp(index + step)]
        pixel = np.uintp(here + np.uintp(index))
        line[pixel] = near if level[pixel] >= np.uint8(WEAK) else np.uint8(0)
