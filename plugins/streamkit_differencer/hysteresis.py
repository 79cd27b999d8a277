"""Foreground by thresholding with hysteresis, without lone pixels.

A registration tolerance hides the grey parts of an object. Pixels above the lower threshold that touch clear
foreground belong to it.

Source: Canny, "A Computational Approach to Edge Detection", PAMI 1986.
"""

from __future__ import annotations

import numpy as np

from streamkit_differencer.arrays import REGION, ByteImage, ByteLine, Region
from streamkit_differencer.lines import clear, is_any_set, unite
from streamkit_differencer.pixel_classes import BACKGROUND, STRONG, WEAK
from streamkit_kernels import BYTES, compiled, kernel

# Growth takes two steps of two pixels.
STEP_PX = 2
MAJORITY = 5
# Blocks without foreground nearby are skipped.
BLOCK_ROWS, BLOCK_PX = 16, 64


@kernel(BYTES, BYTES, REGION)
def strong_mask(levels: ByteImage, mask: ByteImage, region: Region) -> None:
    """The pixels above the upper threshold.

    Args:
        levels: uint8[h, w], see `pixel_classes.classify`.
        mask: uint8[h, w], output.
        region: of both.
    """
    top, bottom, left, right = region
    for row in range(top, bottom):
        level, line = levels[row, left:right], mask[row, left:right]
        for index in range(line.size):
            line[index] = np.uint8(255) if level[index] == np.uint8(STRONG) else np.uint8(0)


@kernel(BYTES, BYTES, BYTES, REGION)
def hysteresis_mask(levels: ByteImage, scratch: ByteImage, mask: ByteImage, region: Region) -> None:
    """The foreground after a median of 3 by 3, grown by two steps of two pixels through weak pixels.

    Args:
        levels: uint8[h, w], see `pixel_classes.classify`; background that the median fills becomes weak.
        scratch: uint8[h, w].
        mask: uint8[h, w], output, within the region.
        region: of all three.
    """
    top, bottom, left, right = region
    _clear_region(mask, region)
    _clear_region(scratch, region)
    united = np.zeros(right - left + 2 * STEP_PX, np.uint8)
    inner = united[STEP_PX : STEP_PX + right - left]
    for first in range(top, bottom, BLOCK_ROWS):
        last = min(first + BLOCK_ROWS, bottom)
        clear(inner)
        for row in range(max(first - 1, top), min(last + 1, bottom)):
            _unite_strong(levels[row, left:right], inner)
        for start in range(left, right, BLOCK_PX):
            stop = min(start + BLOCK_PX, right)
            if is_any_set(united[start - left + STEP_PX - 1 : stop - left + STEP_PX + 1]):
                _median(levels, mask, (first, last, start, stop), region)
    _step(mask, levels, scratch, region, united)
    _clear_region(mask, region)
    _step(scratch, levels, mask, region, united)


@compiled
def _clear_region(mask: ByteImage, region: Region) -> None:
    top, bottom, left, right = region
    for row in range(top, bottom):
        clear(mask[row, left:right])


@compiled
def _unite_strong(level: ByteLine, united: ByteLine) -> None:
    for index in range(united.size):
        united[index] |= np.uint8(255) if level[index] == np.uint8(STRONG) else np.uint8(0)


@compiled
def _median(levels: ByteImage, mask: ByteImage, block: Region, region: Region) -> None:
    """The median of 3 by 3 of a block; the region's border is replicated.

    Background that it fills becomes weak, for growth.
    """
    top, bottom, left, right = region
    first, last, start, stop = block
    sums = np.empty(stop - start + 2, np.uint8)
    low, high = max(start - 1, left), min(stop + 1, right)
    width, level, foreground = levels.shape[1], levels.reshape(-1), mask.reshape(-1)
    for row in range(first, last):
        above, below = max(row - 1, top) * width + low, min(row + 1, bottom - 1) * width + low
        _count(level, above, row * width + low, below, low - start + 1, high - low, sums)
        if low == start:
            sums[0] = sums[1]
        if high == stop:
            sums[stop - start + 1] = sums[stop - start]
        _elect(sums, row * width + start, stop - start, foreground, level)


# Lines are passed as offsets: making a view of each costs as much as processing it.
@compiled
def _count(
    level: ByteLine, above: int, here: int, below: int, first: int, count: int, sums: ByteLine
) -> None:
    """Strong pixels of each column of three, from `first` on."""
    strong, one, none = np.uint8(STRONG), np.uint8(1), np.uint8(0)
    over, middle, under, begin = np.uintp(above), np.uintp(here), np.uintp(below), np.uintp(first)
    for index in range(count):
        step = np.uintp(index)
        total = one if level[np.uintp(over + step)] == strong else none
        total = np.uint8(total + (one if level[np.uintp(middle + step)] == strong else none))
        total = np.uint8(total + (one if level[np.uintp(under + step)] == strong else none))
        sums[np.uintp(begin + step)] = total


@compiled
def _elect(sums: ByteLine, place: int, count: int, foreground: ByteLine, level: ByteLine) -> None:
    begin, one, two = np.uintp(place), np.uintp(1), np.uintp(2)
    for index in range(count):
        step = np.uintp(index)
        votes = np.uint8(np.uint8(sums[step] + sums[np.uintp(step + one)]) + sums[np.uintp(step + two)])
        pixel, is_set = np.uintp(begin + step), votes >= np.uint8(MAJORITY)
        foreground[pixel] = np.uint8(255) if is_set else np.uint8(0)
        level[pixel] = np.uint8(WEAK) if is_set and level[pixel] == np.uint8(BACKGROUND) else level[pixel]


@compiled
def _step(source: ByteImage, levels: ByteImage, target: ByteImage, region: Region, united: ByteLine) -> None:
    """Grows the foreground by `STEP_PX` in each direction through weak pixels, into an empty target."""
    top, bottom, left, right = region
    inner = united[STEP_PX : STEP_PX + right - left]
    for first in range(top, bottom, BLOCK_ROWS):
        last = min(first + BLOCK_ROWS, bottom)
        clear(inner)
        for row in range(max(first - STEP_PX, top), min(last + STEP_PX, bottom)):
            unite(source[row, left:right], inner)
        for start in range(left, right, BLOCK_PX):
            stop = min(start + BLOCK_PX, right)
            if is_any_set(united[start - left : stop - left + 2 * STEP_PX]):
                _spread(source, levels, target, (first, last, start, stop), region)


@compiled
def _spread(source: ByteImage, levels: ByteImage, target: ByteImage, block: Region, region: Region) -> None:
    top, bottom, left, right = region
    first, last, start, stop = block
    column = np.zeros(stop - start + 2 * STEP_PX, np.uint8)
    low, high = max(start - STEP_PX, left), min(stop + STEP_PX, right)
    width, level = levels.shape[1], levels.reshape(-1)
    foreground, line = source.reshape(-1), target.reshape(-1)
    for row in range(first, last):
        clear(column)
        for other in range(max(row - STEP_PX, top), min(row + STEP_PX + 1, bottom)):
            _unite_line(foreground, other * width + low, low - start + STEP_PX, high - low, column)
        _unite_columns(column, row * width + start, stop - start, level, line)


@compiled
def _unite_line(foreground: ByteLine, place: int, first: int, count: int, column: ByteLine) -> None:
    here, begin = np.uintp(place), np.uintp(first)
    for index in range(count):
        column[np.uintp(begin + np.uintp(index))] |= foreground[np.uintp(here + np.uintp(index))]


@compiled
def _unite_columns(column: ByteLine, place: int, count: int, level: ByteLine, line: ByteLine) -> None:
    """The union of each five columns, where the level is weak."""
    here = np.uintp(place)
    for index in range(count):
        near = np.uint8(0)
        for step in range(2 * STEP_PX + 1):
            near |= column[np.uintp(index + step)]
        pixel = np.uintp(here + np.uintp(index))
        line[pixel] = near if level[pixel] >= np.uint8(WEAK) else np.uint8(0)
