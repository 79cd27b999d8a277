"""Ground that has just come into view: until its background is known, the frame of tau before stands for it.

A car that enters the picture drives on ground that was never quiet. What drives there differs from what the
first look showed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import types

from streamkit_differencer.canvas_region import REGION
from streamkit_differencer.changes import LONGEST_WAIT
from streamkit_kernels import BYTES, FLOATS, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    ByteLine = NDArray[np.uint8]

# What `valid` is where the background is a first look. A level of `contrast.judge` passes through both bits.
FIRST_LOOK = 3
# The noise of pixels that get none.
NO_FIRST_LOOK = 0.0
# New pixels are few; lines are searched for them by pieces of this length.
BLOCK_PX = 64


@kernel(
    BYTES,
    BYTES,
    BYTES,
    BYTES,
    FLOATS,
    BYTES,
    FLOATS,
    BYTES,
    REGION,
    types.float64,
    types.float64,
    types.float64,
    types.int64,
    types.int64,
)
def look_first(
    seen: ByteImage,
    earlier: ByteImage,
    earlier_seen: ByteImage,
    waiting: ByteImage,
    background: FloatImage,
    valid: ByteImage,
    spread: FloatImage,
    needed: ByteImage,
    region: Region,
    first: float,
    edge: float,
    gain: float,
    lowest: int,
    highest: int,
) -> None:
    """Gives pixels without background that of the frame of tau before, where that and this frame are alike.

    Args:
        seen: uint8[h, w], mask of what the frame covers, on the canvas; so are all.
        earlier: uint8[h, w], f(t - tau).
        earlier_seen: uint8[h, w], mask of what that covers.
        waiting: uint8[h, w], see `changes.update_waiting`; the most where a pixel has just changed.
        background: float32[h, w], B; set there.
        valid: uint8[h, w], where that is known; becomes `FIRST_LOOK` there.
        spread: float32[h, w], mean absolute deviation, grey levels; set there, unless it is `NO_FIRST_LOOK`.
        needed: uint8[h, w], T_F; set there.
        region: what the frame covers at most; nothing else is read or written.
        first: deviation of a pixel whose background is a single frame.
        edge: what the local range adds to it, per grey level.
        gain: the threshold over the mean deviation.
        lowest: smallest threshold, grey levels.
        highest: largest threshold.
    """
    top, bottom, left, right = region
    for row in range(top, bottom):
        known, waits = valid[row, left:right], waiting[row, left:right]
        if not _has_unknown(known):
            continue
        now, before = seen[row, left:right], earlier_seen[row, left:right]
        for start in range(0, known.size, BLOCK_PX):
            count = min(BLOCK_PX, known.size - start)
            if not _is_any_new(known, now, before, start, count):
                continue
            for index in range(start, start + count):
                if known[index] == 0 and now[index] & before[index] and waits[index] < LONGEST_WAIT:
                    column = left + index
                    if spread[row, column] == np.float32(NO_FIRST_LOOK):
                        continue
                    known[index] = FIRST_LOOK
                    background[row, column] = earlier[row, column]
                    rough = np.float32(edge) * _range(earlier, row, column, region) + np.float32(first)
                    spread[row, column] = rough
                    limit = min(np.rint(rough * np.float32(gain)), np.float32(highest))
                    needed[row, column] = np.uint8(np.int32(max(limit, np.float32(lowest))))


@compiled
def _has_unknown(known: ByteLine) -> bool:
    least = np.uint8(255)
    for index in range(known.size):
        least = min(least, known[index])
    return bool(least == np.uint8(0))


@compiled
def _is_any_new(known: ByteLine, now: ByteLine, before: ByteLine, start: int, count: int) -> bool:
    """Whether a part of a line is unknown in places that both frames show."""
    united = np.uint8(0)
    for step in range(count):
        index = np.uint64(start) + np.uint64(step)
        is_unknown = np.uint8(255) if known[index] == np.uint8(0) else np.uint8(0)
        united |= is_unknown & now[index] & before[index]
    return bool(united > 0)


@compiled
def _range(image: ByteImage, row: int, column: int, region: Region) -> np.float32:
    """The range of values within a pixel."""
    top, bottom, left, right = region
    low, high = np.uint8(255), np.uint8(0)
    for y in range(max(row - 1, top), min(row + 2, bottom)):
        for x in range(max(column - 1, left), min(column + 2, right)):
            low, high = min(low, image[y, x]), max(high, image[y, x])
    return np.float32(high - low)
