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
    for row in range(first, last):
        _count(
            levels[max(row - 1, top), low:high],
            levels[row, low:high],
            levels[min(row + 1, bottom - 1), low:high],
            sums[low - start + 1 : high - start + 1],
        )
        if low == start:
            sums[0] = sums[1]
        if high == stop:
            sums[stop - start + 1] = sums[stop - start]
        _elect(sums, mask[row, start:stop], levels[row, start:stop])


@compiled
def _count(above: ByteLine, here: ByteLine, below: ByteLine, sums: ByteLine) -> None:
    """How many of three pixels are strong."""
    strong, one, none = np.uint8(STRONG), np.uint8(1), np.uint8(0)
    for index in range(sums.size):
        total = one if above[index] == strong else none
        total = np.uint8(total + (one if here[index] == strong else none))
        sums[index] = np.uint8(total + (one if below[index] == strong else none))


@compiled
def _elect(sums: ByteLine, line: ByteLine, level: ByteLine) -> None:
    for index in range(line.size):
        votes = np.uint8(np.uint8(sums[index] + sums[index + 1]) + sums[index + 2])
        is_thing = votes >= np.uint8(MAJORITY)
        line[index] = np.uint8(255) if is_thing else np.uint8(0)
        level[index] = np.uint8(WEAK) if is_thing and level[index] == np.uint8(GROUND) else level[index]


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
    for row in range(first, last):
        # A line that is taken twice changes nothing.
        _unite_lines(
            source[max(row - 2, top), low:high],
            source[max(row - 1, top), low:high],
            source[row, low:high],
            source[min(row + 1, bottom - 1), low:high],
            source[min(row + 2, bottom - 1), low:high],
            column[low - start + STEP_PX : high - start + STEP_PX],
        )
        _unite_columns(column, levels[row, start:stop], target[row, start:stop])


@compiled
def _unite_lines(
    first: ByteLine, second: ByteLine, third: ByteLine, fourth: ByteLine, fifth: ByteLine, line: ByteLine
) -> None:
    for index in range(line.size):
        line[index] = first[index] | second[index] | third[index] | fourth[index] | fifth[index]


@compiled
def _unite_columns(column: ByteLine, level: ByteLine, line: ByteLine) -> None:
    """Of five pixels of a column each, where that is weak."""
    for index in range(line.size):
        near = column[index] | column[index + 1] | column[index + 2] | column[index + 3] | column[index + 4]
        line[index] = near if level[index] >= np.uint8(WEAK) else np.uint8(0)
