"""Provisional background of ground that has just come into view: an earlier frame, until it was quiet.

A vehicle that enters the frame drives on ground that was never quiet; it differs from the provisional
background.
"""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import REGION, ByteImage, ByteLine, FloatImage, Region
from streamkit_differencer.changes import LONGEST_WAIT
from streamkit_differencer.learning import initial_noise
from streamkit_kernels import BYTES, FLOATS, compiled, kernel

# Value of `valid` where the background is provisional; a mask for the levels of `pixel_classes.classify`.
PROVISIONAL = 3
# Deviation that marks pixels which never get a provisional background.
NEVER_PROVISIONAL = 0.0
# Parts of a line without new pixels are skipped.
BLOCK_PX = 64


@kernel(*[BYTES] * 4, FLOATS, BYTES, FLOATS, BYTES, REGION, *[types.float64] * 3, *[types.int64] * 2)
def set_provisional(
    seen: ByteImage,
    earlier: ByteImage,
    earlier_seen: ByteImage,
    waiting: ByteImage,
    background: FloatImage,
    valid: ByteImage,
    deviation: FloatImage,
    thresholds: ByteImage,
    region: Region,
    first: float,
    edge: float,
    gain: float,
    lowest: int,
    highest: int,
) -> None:
    """Gives pixels without background that of the earlier frame, where both frames are alike.

    Args:
        seen: uint8[h, w], mask of what the frame covers, on the canvas, as all images.
        earlier: uint8[h, w], f(t - tau).
        earlier_seen: uint8[h, w], mask of what it covers.
        waiting: uint8[h, w], see `changes.update_waiting`.
        background: float32[h, w], B; set there.
        valid: uint8[h, w], mask of where it is known; set to `PROVISIONAL` there.
        deviation: float32[h, w], mean absolute deviation, grey levels; set there, unless `NEVER_PROVISIONAL`.
        thresholds: uint8[h, w], T_F; set there.
        region: bounds of the frame; nothing else is read or written.
        first: deviation of a pixel whose background is a single frame.
        edge: share of the local range that is added to it.
        gain: threshold over mean deviation.
        lowest: smallest threshold, grey levels.
        highest: largest threshold.
    """
    top, bottom, left, right = region
    limits = first, edge, gain, lowest, highest
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
                    if deviation[row, column] == np.float32(NEVER_PROVISIONAL):
                        continue
                    known[index] = PROVISIONAL
                    background[row, column] = earlier[row, column]
                    initial_noise(earlier, row, column, region, deviation, thresholds, limits)


@compiled
def _has_unknown(known: ByteLine) -> bool:
    least = np.uint8(255)
    for index in range(known.size):
        least = min(least, known[index])
    return bool(least == np.uint8(0))


@compiled
def _is_any_new(known: ByteLine, now: ByteLine, before: ByteLine, start: int, count: int) -> bool:
    """Whether a part of a line has unknown pixels that both frames show."""
    united = np.uint8(0)
    for step in range(count):
        index = np.uint64(start) + np.uint64(step)
        is_unknown = np.uint8(255) if known[index] == np.uint8(0) else np.uint8(0)
        united |= is_unknown & now[index] & before[index]
    return bool(united > 0)
