"""Equation 4 on the canvas in one pass: how clearly each pixel differs from the background."""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import REGION, ByteImage, ByteLine, FloatImage, FloatLine, Region
from streamkit_differencer.lines import clear
from streamkit_kernels import BYTES, FLOATS, compiled, kernel

# Without a known background, similar to it, above the lower threshold of the hysteresis, above the upper one.
UNKNOWN, BACKGROUND, WEAK, STRONG = 0, 1, 2, 3
# Smallest lower threshold, grey levels.
LEAST_WEAK = 5.0


@kernel(BYTES, BYTES, FLOATS, BYTES, BYTES, BYTES, BYTES, REGION, types.int64, types.float64, types.float64)
def classify(
    image: ByteImage,
    seen: ByteImage,
    background: FloatImage,
    valid: ByteImage,
    thresholds: ByteImage,
    rounded: ByteImage,
    levels: ByteImage,
    region: Region,
    tolerance: int,
    gradient_gain: float,
    hysteresis_ratio: float,
) -> None:
    """Compares a frame with the range of the background within the tolerance of each pixel.

    Args:
        image: uint8[h, w], f(t) on the canvas, as all images.
        seen: uint8[h, w], mask of what the frame covers.
        background: float32[h, w], B(t - 1).
        valid: uint8[h, w], mask of where it is known.
        thresholds: uint8[h, w], T_F of each pixel, grey levels; a difference exceeds it.
        rounded: uint8[h, w], output: B(t - 1) in whole grey levels; bytes are four times as fast.
        levels: uint8[h, w], output: `UNKNOWN`, `BACKGROUND`, `WEAK` or `STRONG`.
        region: bounds of the frame; nothing else is read or written.
        tolerance: registration error to tolerate, px.
        gradient_gain: share of the background's local range that is added to the threshold.
        hysteresis_ratio: lower threshold over the upper one.
    """
    top, bottom, left, right = region
    count, reach = right - left, max(tolerance, 1)
    lowest, highest = np.empty(count + 2 * reach, np.uint8), np.empty(count + 2 * reach, np.uint8)
    low, high, tolerated = np.empty(count, np.uint8), np.empty(count, np.uint8), np.zeros(count, np.uint8)
    for row in range(top, min(top + reach, bottom)):
        _rounded(background[row, left:right], rounded[row, left:right])
    for row in range(top, bottom):
        if row + reach < bottom:
            _rounded(background[row + reach, left:right], rounded[row + reach, left:right])
        line, here, limits = image[row, left:right], rounded[row, left:right], thresholds[row, left:right]
        level = levels[row, left:right]
        # Tolerance and gain only lower the difference: most rows are finished here.
        _upper_bound(line, here, limits, level)
        _known(seen[row, left:right], valid[row, left:right], level)
        largest = _largest(level)
        if largest <= BACKGROUND:
            continue
        if largest < STRONG:
            clear(level)
        else:
            if tolerance > 0 or gradient_gain > 0.0:
                _copied(here, lowest[reach : reach + count])
                _copied(here, highest[reach : reach + count])
                for other in range(max(row - reach, top), min(row + reach + 1, bottom)):
                    near = rounded[other, left:right]
                    _widen(near, near, lowest[reach : reach + count], highest[reach : reach + count])
                _bounds(lowest, highest, reach, low, high)
            if gradient_gain > 0.0:
                _tolerated(low, high, np.float32(gradient_gain), tolerated)
            if tolerance == 0:
                _copied(here, low)
                _copied(here, high)
            _strong(line, low, high, limits, tolerated, level)
        _weak(line, here, limits, np.float32(hysteresis_ratio), level)
        _known(seen[row, left:right], valid[row, left:right], level)


@compiled
def _upper_bound(line: ByteLine, background: ByteLine, thresholds: ByteLine, level: ByteLine) -> None:
    """The highest level that each pixel of a line can have."""
    for index in range(level.size):
        value, other = line[index], background[index]
        difference = np.uint8(max(value, other) - min(value, other))
        kind = np.uint8(WEAK) if difference > np.uint8(LEAST_WEAK) else np.uint8(BACKGROUND)
        level[index] = np.uint8(STRONG) if difference > thresholds[index] else kind


@compiled
def _largest(level: ByteLine) -> int:
    largest = np.uint8(UNKNOWN)
    for index in range(level.size):
        largest = max(largest, level[index])
    return int(largest)


@compiled
def _copied(line: ByteLine, target: ByteLine) -> None:
    """Assigning to a slice takes ten times as long."""
    for index in range(line.size):
        target[index] = line[index]


@compiled
def _rounded(line: FloatLine, rounded: ByteLine) -> None:
    for index in range(rounded.size):
        rounded[index] = np.uint8(np.int32(np.rint(line[index])))


@compiled
def _bounds(lowest: ByteLine, highest: ByteLine, reach: int, low: ByteLine, high: ByteLine) -> None:
    """Extremes of a line within `reach`."""
    count = low.size
    for index in range(reach):
        lowest[index], highest[index] = lowest[reach], highest[reach]
        last = reach + count - 1
        lowest[last + 1 + index], highest[last + 1 + index] = lowest[last], highest[last]
    _copied(lowest[:count], low)
    _copied(highest[:count], high)
    for step in range(1, 2 * reach + 1):
        _widen(lowest[step : step + count], highest[step : step + count], low, high)


@compiled
def _widen(lowest: ByteLine, highest: ByteLine, low: ByteLine, high: ByteLine) -> None:
    for index in range(low.size):
        low[index] = min(low[index], lowest[index])
        high[index] = max(high[index], highest[index])


@compiled
def _tolerated(low: ByteLine, high: ByteLine, gain: np.float32, tolerated: ByteLine) -> None:
    for index in range(low.size):
        share = np.rint(np.float32(np.uint8(high[index] - low[index])) * gain)
        tolerated[index] = np.uint8(np.int32(min(share, np.float32(255.0))))


@compiled
def _strong(
    line: ByteLine, low: ByteLine, high: ByteLine, thresholds: ByteLine, tolerated: ByteLine, level: ByteLine
) -> None:
    """Equation 4 for a line: 255 for foreground, else 0."""
    for index in range(line.size):
        value = line[index]
        above = np.uint8(max(value, high[index]) - high[index])
        below = np.uint8(low[index] - min(value, low[index]))
        excess = max(above, below)
        excess = np.uint8(max(excess, tolerated[index]) - tolerated[index])
        level[index] = np.uint8(255) if excess > thresholds[index] else np.uint8(0)


@compiled
def _weak(
    line: ByteLine, background: ByteLine, thresholds: ByteLine, share: np.float32, level: ByteLine
) -> None:
    """Levels of a line, as if all of its background were known."""
    least = np.float32(LEAST_WEAK)
    for index in range(line.size):
        value, other = line[index], background[index]
        difference = np.float32(np.uint8(max(value, other) - min(value, other)))
        is_weak = difference > max(np.rint(np.float32(thresholds[index]) * share), least)
        kind = np.uint8(WEAK) if is_weak else np.uint8(BACKGROUND)
        level[index] = np.uint8(STRONG) if level[index] > 0 else kind


@compiled
def _known(seen: ByteLine, valid: ByteLine, level: ByteLine) -> None:
    for index in range(level.size):
        level[index] = level[index] & seen[index] & valid[index]
