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
    Flags = NDArray[np.bool_]

# Growth takes so many steps of so many pixels.
STEP_PX = 2
MAJORITY = 5


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
    for row in range(top, bottom):
        _strong(levels[row, left:right], room[row, left:right])
    filled = _lines_with_something(room, region)
    for row in range(top, bottom):
        line = mask[row, left:right]
        _empty(line)
        if _is_any(filled, row - top, 1):
            above, below = room[max(row - 1, top), left:right], room[min(row + 1, bottom - 1), left:right]
            _majority(above, room[row, left:right], below, line)
            _fill(line, levels[row, left:right])
    _step(mask, levels, room, region)
    _step(room, levels, mask, region)


@compiled
def _strong(level: ByteLine, line: ByteLine) -> None:
    for index in range(line.size):
        line[index] = np.uint8(255) if level[index] == np.uint8(STRONG) else np.uint8(0)


@compiled
def _lines_with_something(mask: ByteImage, region: Region) -> Flags:
    top, bottom, left, right = region
    found = np.zeros(bottom - top, np.bool_)
    for row in range(top, bottom):
        line = mask[row, left:right]
        total = np.uint8(0)
        for index in range(line.size):
            total |= line[index]
        found[row - top] = total > 0
    return found


@compiled
def _is_any(filled: Flags, index: int, reach: int) -> bool:
    """Whether one of the lines within `reach` has something."""
    found = False
    for other in range(max(index - reach, 0), min(index + reach + 1, filled.size)):
        found |= filled[other]
    return found


@compiled
def _empty(line: ByteLine) -> None:
    for index in range(line.size):
        line[index] = 0


@compiled
def _majority(above: ByteLine, here: ByteLine, below: ByteLine, line: ByteLine) -> None:
    """The median of a line's squares of three by three; beyond the picture it goes on as at its border."""
    count = line.size
    sums = np.empty(count + 2, np.uint8)
    one = np.uint8(1)
    for index in range(count):
        sums[index + 1] = (above[index] & one) + (here[index] & one) + (below[index] & one)
    sums[0], sums[count + 1] = sums[1], sums[count]
    for index in range(count):
        votes = np.uint8(sums[index] + sums[index + 1] + sums[index + 2])
        line[index] = np.uint8(255) if votes >= np.uint8(MAJORITY) else np.uint8(0)


@compiled
def _fill(line: ByteLine, level: ByteLine) -> None:
    """What is known and lies among foreground may be grown into."""
    for index in range(line.size):
        is_ground = level[index] == np.uint8(GROUND)
        level[index] = np.uint8(WEAK) if is_ground and line[index] > 0 else level[index]


@compiled
def _step(source: ByteImage, levels: ByteImage, target: ByteImage, region: Region) -> None:
    """Grows the foreground by `STEP_PX` in each direction, where that is weak."""
    top, bottom, left, right = region
    count = right - left
    filled = _lines_with_something(source, region)
    column = np.zeros(count + 2 * STEP_PX, np.uint8)
    inner = column[STEP_PX : STEP_PX + count]
    for row in range(top, bottom):
        line = target[row, left:right]
        _empty(line)
        first, last = max(row - STEP_PX, top), min(row + STEP_PX + 1, bottom)
        if not _is_any(filled, row - top, STEP_PX):
            continue
        _empty(inner)
        for other in range(first, last):
            _united(source[other, left:right], inner)
        for step in range(2 * STEP_PX + 1):
            _united(column[step : step + count], line)
        _allowed(levels[row, left:right], line)


@compiled
def _united(other: ByteLine, line: ByteLine) -> None:
    for index in range(line.size):
        line[index] |= other[index]


@compiled
def _allowed(level: ByteLine, line: ByteLine) -> None:
    for index in range(line.size):
        line[index] = line[index] if level[index] >= np.uint8(WEAK) else np.uint8(0)
