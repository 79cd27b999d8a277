"""Equations 1 and 2 on the canvas in one pass: what changed since tau frames before, and what is quiet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import types

from streamkit_differencer.canvas_region import REGION
from streamkit_kernels import BYTES, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    ByteLine = NDArray[np.uint8]

# Largest lambda that a byte holds.
LONGEST_WAIT = 255
# Every so-manieth line tells the share of the picture that changed.
SHARE_STEP = 4


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
) -> tuple[int, int]:
    """Counts down what every pixel has to wait, or begins anew where it changed.

    A pixel that was not in view in both frames is not known to be quiet: it counts as changed. D is kept as
    what is left of the longest wait, so that a change needs no branch: it is quiet where no more than
    `LONGEST_WAIT` less lambda is left.

    Args:
        image: uint8[h, w], f(t) on the canvas; so are all.
        seen: uint8[h, w], mask of what the frame covers.
        earlier: uint8[h, w], f(t - tau).
        earlier_seen: uint8[h, w], mask of what that covers.
        waiting: uint8[h, w], updated in place.
        quiet: uint8[h, w], becomes the mask of D = 0.
        region: what the frame covers at most; nothing else is read or written.
        threshold: T_s, grey levels; a change must exceed it.
        gradient_gain: raises the threshold by this share of the local range of `earlier`, so that an error
            of registration at an edge is not taken for a change.
        quiet_frames: lambda.

    Returns:
        Of every fourth line: pixels that changed among those in both frames, and how many those are.
    """
    top, bottom, left, right = region
    count = right - left
    lowest, highest = np.empty(count + 2, np.uint8), np.empty(count + 2, np.uint8)
    ranges, both, changed = np.empty(count, np.uint8), np.empty(count, np.uint8), np.empty(count, np.uint8)
    step = SHARE_STEP if bottom - top >= SHARE_STEP**2 else 1
    total, common = np.int64(0), np.int64(0)
    # Differences are whole.
    most = np.uint8(min(max(threshold, 0.0), 255.0))
    for row in range(top, bottom):
        line, here = image[row, left:right], earlier[row, left:right]
        _both(seen[row, left:right], earlier_seen[row, left:right], both)
        # The gain makes no more of a difference: most lines are done with here.
        _differs(line, here, both, most, changed)
        if gradient_gain > 0.0 and _has_something(changed):
            above, below = (
                earlier[max(row - 1, top), left:right],
                earlier[min(row + 1, bottom - 1), left:right],
            )
            _range_around(above, here, below, lowest, highest, ranges)
            _changed(line, here, ranges, np.float32(threshold), np.float32(gradient_gain), changed)
        if (row - top) % step == 0:
            for index in range(count):
                total += np.int64(changed[index] & both[index] & np.uint8(1))
                common += np.int64(both[index] & np.uint8(1))
        _wait(changed, both, waiting[row, left:right], quiet[row, left:right], quiet_frames)
    return int(total), int(common)


@compiled
def _differs(line: ByteLine, earlier: ByteLine, both: ByteLine, most: np.uint8, changed: ByteLine) -> None:
    """Equation 2 for a line without edges."""
    for index in range(changed.size):
        now, before = line[index], earlier[index]
        difference = np.uint8(max(now, before) - min(now, before))
        changed[index] = (np.uint8(255) if difference > most else np.uint8(0)) & both[index]


@compiled
def _has_something(line: ByteLine) -> bool:
    united = np.uint8(0)
    for index in range(line.size):
        united |= line[index]
    return bool(united > 0)


@compiled
def _range_around(
    above: ByteLine, here: ByteLine, below: ByteLine, lowest: ByteLine, highest: ByteLine, ranges: ByteLine
) -> None:
    """The range of values within a pixel of each of a line; beyond the ends of the line there is nothing."""
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
        borne = np.rint(np.float32(ranges[index]) * gain)
        changed[index] = np.uint8(255) if difference - borne > threshold else np.uint8(0)


@compiled
def _wait(changed: ByteLine, both: ByteLine, waiting: ByteLine, quiet: ByteLine, quiet_frames: int) -> None:
    """Equation 1 for a line."""
    most = np.uint8(LONGEST_WAIT - quiet_frames)
    for index in range(quiet.size):
        left = waiting[index]
        left = np.uint8(left - np.uint8(min(left, np.uint8(1))))
        # Not `~`: of a byte that is a longer number, and fewer of those are handled at once.
        left = np.uint8(left | changed[index] | np.uint8(both[index] ^ np.uint8(255)))
        waiting[index] = left
        quiet[index] = np.uint8(255) if left <= most else np.uint8(0)
