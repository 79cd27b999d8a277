"""Equations 1 and 2 on the canvas in one pass: changed pixels and quiet pixels."""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import REGION, ByteImage, ByteLine, Region
from streamkit_differencer.lines import is_any_set
from streamkit_kernels import BYTES, compiled, kernel

# Largest lambda.
LONGEST_WAIT = 255


@kernel(BYTES, BYTES, BYTES, BYTES, BYTES, BYTES, REGION, types.float64, types.float64, types.int64)
def update_waiting(
    image: ByteImage,
    seen: ByteImage,
    earlier: ByteImage,
    earlier_seen: ByteImage,
    waiting: ByteImage,
    quiet: ByteImage,
    region: Region,
    threshold: float,
    gradient_gain: float,
    quiet_frames: int,
) -> None:
    """Counts down the frames that every pixel has to wait until it is quiet; restarts where it changed.

    A pixel that is not in both frames counts as changed. The counter is kept relative to the longest wait, so
    that a change needs no branch: D = 0 where it is at most `LONGEST_WAIT` - lambda.

    Args:
        image: uint8[h, w], f(t) on the canvas, as all images.
        seen: uint8[h, w], mask of what the frame covers.
        earlier: uint8[h, w], f(t - tau).
        earlier_seen: uint8[h, w], mask of what it covers.
        waiting: uint8[h, w], the counter, updated in place.
        quiet: uint8[h, w], output: mask of D = 0.
        region: bounds of the frame; nothing else is read or written.
        threshold: T_s, grey levels; a change exceeds it.
        gradient_gain: share of the local range of `earlier` added to the threshold, so that a registration
            error at an edge is no change.
        quiet_frames: lambda.
    """
    top, bottom, left, right = region
    count = right - left
    lowest, highest = np.empty(count + 2, np.uint8), np.empty(count + 2, np.uint8)
    ranges, both, changed = np.empty(count, np.uint8), np.empty(count, np.uint8), np.empty(count, np.uint8)
    # Differences are whole numbers.
    most = np.uint8(min(max(threshold, 0.0), 255.0))
    for row in range(top, bottom):
        line, here = image[row, left:right], earlier[row, left:right]
        _both(seen[row, left:right], earlier_seen[row, left:right], both)
        # The gain only raises the threshold: most rows are finished here.
        _differs(line, here, both, most, changed)
        if gradient_gain > 0.0 and is_any_set(changed):
            above, below = (
                earlier[max(row - 1, top), left:right],
                earlier[min(row + 1, bottom - 1), left:right],
            )
            _range_around(above, here, below, lowest, highest, ranges)
            _changed(line, here, ranges, np.float32(threshold), np.float32(gradient_gain), changed)
        _wait(changed, both, waiting[row, left:right], quiet[row, left:right], quiet_frames)


@compiled
def _differs(line: ByteLine, earlier: ByteLine, both: ByteLine, most: np.uint8, changed: ByteLine) -> None:
    """Equation 2 for a line, without the gain."""
    for index in range(changed.size):
        now, before = line[index], earlier[index]
        difference = np.uint8(max(now, before) - min(now, before))
        changed[index] = (np.uint8(255) if difference > most else np.uint8(0)) & both[index]


@compiled
def _range_around(
    above: ByteLine, here: ByteLine, below: ByteLine, lowest: ByteLine, highest: ByteLine, ranges: ByteLine
) -> None:
    """The local range of each pixel of a line."""
    count = here.size
    for index in range(count):
        value, over, under = here[index], above[index], below[index]
        lowest[index + 1] = min(over, value, under)
        highest[index + 1] = max(over, value, under)
    lowest[0], lowest[count + 1] = lowest[1], lowest[count]
    highest[0], highest[count + 1] = highest[1], highest[count]
    for index in range(count):
        low = min(lowest[index], lowest[index + 1], lowest[index + 2])
        high = max(highest[index], highest[index + 1], highest[index + 2])
        ranges[index] = np.uint8(high - low)


@compiled
def _both(first: ByteLine, second: ByteLine, both: ByteLine) -> None:
    for index in range(both.size):
        both[index] = first[index] & second[index]


@compiled
def _changed(
    line: ByteLine,
    earlier: ByteLine,
    ranges: ByteLine,
    threshold: np.float32,
    gain: np.float32,
    changed: ByteLine,
) -> None:
    """Equation 2 for a line."""
    for index in range(changed.size):
        now, before = line[index], earlier[index]
        difference = np.float32(np.uint8(max(now, before) - min(now, before)))
        tolerated = np.rint(np.float32(ranges[index]) * gain)
        changed[index] = np.uint8(255) if difference - tolerated > threshold else np.uint8(0)


@compiled
def _wait(changed: ByteLine, both: ByteLine, waiting: ByteLine, quiet: ByteLine, quiet_frames: int) -> None:
    """Equation 1 for a line."""
    most = np.uint8(LONGEST_WAIT - quiet_frames)
    for index in range(quiet.size):
        left = waiting[index]
        left = np.uint8(left - np.uint8(min(left, np.uint8(1))))
        # `~` would widen the byte, and fewer pixels fit a vector.
        left = np.uint8(left | changed[index] | np.uint8(both[index] ^ np.uint8(255)))
        waiting[index] = left
        quiet[index] = np.uint8(255) if left <= most else np.uint8(0)
