"""The noise of each pixel, and the provisional background of ground that was not quiet yet.

Ground that has just come into view gets an earlier frame for background until it was quiet: a vehicle that
enters the frame drives on ground that was never quiet, and differs from that.
"""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import REGION, ByteImage, ByteLine, FloatImage, FloatLine, Region
from streamkit_differencer.changes import LONGEST_WAIT
from streamkit_differencer.learning import AVERAGED, NEW, NONE, PROVISIONAL
from streamkit_differencer.lines import clear, local_range
from streamkit_kernels import BYTES, FLOATS, compiled, kernel

# Blocks without new pixels are skipped.
BLOCK_ROWS, BLOCK_PX = 16, 64


@kernel(*[BYTES] * 5, FLOATS, BYTES, REGION, *[types.float64] * 3, types.int64, types.int64)
def learn_noise(
    image: ByteImage,
    rounded: ByteImage,
    updates: ByteImage,
    mask: ByteImage,
    valid: ByteImage,
    deviation: FloatImage,
    thresholds: ByteImage,
    region: Region,
    learning_rate: float,
    restless_rate: float,
    gain: float,
    lowest: int,
    highest: int,
) -> None:
    """Learns the mean absolute deviation of averaged pixels, as a running mean, and their thresholds.

    Background pixels that were never quiet, such as water, have the most noise, and count, too.

    Args:
        image: uint8[h, w], f(t) on the canvas, as all images.
        rounded: uint8[h, w], B(t - 1).
        updates: uint8[h, w], see `learning.learn`.
        mask: uint8[h, w], foreground.
        valid: uint8[h, w], mask of where the background is known.
        deviation: float32[h, w], grey levels; updated in place.
        thresholds: uint8[h, w], T_F of each pixel, updated in place; the old one limits what a missed object
            adds to the deviation.
        region: bounds of the frame.
        learning_rate: weight of this frame, 0 to 1.
        restless_rate: the same for pixels that were never quiet.
        gain: threshold over mean deviation.
        lowest: smallest threshold, grey levels.
        highest: largest threshold.
    """
    top, bottom, left, right = region
    for row in range(top, bottom):
        deviations, limits = deviation[row, left:right], thresholds[row, left:right]
        line, background, update = image[row, left:right], rounded[row, left:right], updates[row, left:right]
        states = update, mask[row, left:right], valid[row, left:right]
        rates = np.float32(learning_rate), np.float32(restless_rate)
        _average_deviation(line, background, *states, limits, *rates, deviations)
        _set_thresholds(deviations, limits, gain, lowest, highest)


@compiled
def _average_deviation(
    line: ByteLine,
    background: ByteLine,
    update: ByteLine,
    mask: ByteLine,
    valid: ByteLine,
    thresholds: ByteLine,
    learning_rate: np.float32,
    restless_rate: np.float32,
    deviation: FloatLine,
) -> None:
    one, none = np.float32(1.0), np.float32(0.0)
    for index in range(line.size):
        value, other = line[index], background[index]
        current = np.float32(min(np.uint8(max(value, other) - min(value, other)), thresholds[index]))
        is_restless = mask[index] == np.uint8(0) and valid[index] == np.uint8(PROVISIONAL)
        weight = learning_rate if update[index] == np.uint8(AVERAGED) else none
        weight = restless_rate if is_restless else weight
        deviation[index] = deviation[index] * (one - weight) + current * weight


@compiled
def _threshold_of(deviation: np.float32, gain: np.float32, least: np.float32, most: np.float32) -> np.uint8:
    return np.uint8(np.int32(max(min(np.rint(deviation * gain), most), least)))


@compiled
def _set_thresholds(
    deviation: FloatLine, thresholds: ByteLine, gain: float, lowest: int, highest: int
) -> None:
    factor, least, most = np.float32(gain), np.float32(lowest), np.float32(highest)
    for index in range(deviation.size):
        thresholds[index] = _threshold_of(deviation[index], factor, least, most)


@kernel(FLOATS, BYTES, REGION, types.float64, types.int64, types.int64)
def set_thresholds(
    deviation: FloatImage, thresholds: ByteImage, region: Region, gain: float, lowest: int, highest: int
) -> None:
    """T_F of each pixel from its mean deviation, see `learn_noise`."""
    top, bottom, left, right = region
    for row in range(top, bottom):
        _set_thresholds(deviation[row, left:right], thresholds[row, left:right], gain, lowest, highest)


@kernel(BYTES, BYTES, FLOATS, BYTES, REGION, *[types.float64] * 3, types.int64, types.int64)
def begin_noise(
    earlier: ByteImage,
    updates: ByteImage,
    deviation: FloatImage,
    thresholds: ByteImage,
    region: Region,
    first: float,
    edge: float,
    gain: float,
    lowest: int,
    highest: int,
) -> None:
    """Initialises the noise and the thresholds of new pixels, from the local range of an earlier frame.

    `earlier` is f(t - tau), `first` the deviation of a pixel whose background is a single frame, and `edge`
    the share of the local range that is added to it; the other arguments are those of `learn_noise`.
    """
    top, bottom, left, right = region
    largest = np.empty(right - left, np.uint8)
    limits = first, edge, gain, lowest, highest
    for start in range(top, bottom, BLOCK_ROWS):
        stop = min(start + BLOCK_ROWS, bottom)
        clear(largest)
        for row in range(start, stop):
            _maximum(updates[row, left:right], largest)
        for block in range(left, right, BLOCK_PX):
            end = min(block + BLOCK_PX, right)
            if not _has_new(largest[block - left : end - left]):
                continue
            for row in range(start, stop):
                update = updates[row, block:end]
                for column in range(block, end):
                    if update[np.uintp(column - block)] == np.uint8(NEW):
                        _initial_noise(earlier, row, column, region, deviation, thresholds, limits)


@compiled
def _initial_noise(
    image: ByteImage,
    row: int,
    column: int,
    region: Region,
    deviation: FloatImage,
    thresholds: ByteImage,
    limits: tuple[float, float, float, int, int],
) -> None:
    """Sets the noise and the threshold of one pixel; `limits` are the last arguments of `begin_noise`."""
    first, edge, gain, lowest, highest = limits
    rough = np.float32(edge) * np.float32(local_range(image, row, column, region)) + np.float32(first)
    deviation[row, column] = rough
    least, most = np.float32(lowest), np.float32(highest)
    thresholds[row, column] = _threshold_of(rough, np.float32(gain), least, most)


@compiled
def _has_new(update: ByteLine) -> bool:
    largest = np.uint8(NONE)
    for index in range(update.size):
        largest = max(largest, update[index])
    return bool(largest == np.uint8(NEW))


@compiled
def _maximum(update: ByteLine, largest: ByteLine) -> None:
    for index in range(update.size):
        largest[index] = max(largest[index], update[index])


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

    Their noise is initialised, too. `seen` and `earlier_seen` are masks of what the two frames cover,
    `waiting` is that of `changes.update_waiting`; the other arguments are those of `begin_noise`.
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
                    known[index] = PROVISIONAL
                    background[row, column] = earlier[row, column]
                    _initial_noise(earlier, row, column, region, deviation, thresholds, limits)


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
