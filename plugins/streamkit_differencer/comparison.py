"""A frame compared with an earlier one and with the background, pixel by pixel, on the canvas."""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import (
    BOUNDS,
    SPANS,
    Bounds,
    ByteImage,
    ByteLine,
    FloatImage,
    FloatLine,
    Spans,
    has_set,
)
from streamkit_differencer.equations import (
    MAX_WAIT,
    SET,
    count_down,
    find_changes,
    find_foreground_pixels,
    find_quiet,
)
from streamkit_differencer.ground import DEVIATION_STEPS, PROVISIONAL, UNKNOWN, UNSEEN
from streamkit_differencer.noise import EDGE_SHARE, FIRST_DEVIATION, find_thresholds
from streamkit_kernels import FLOAT32, UINT8, compiled, kernel

# Threshold of pixels that are not compared: no difference exceeds it.
UNCOMPARED = 255


@kernel(UINT8, UINT8, UINT8, FLOAT32, UINT8, UINT8, BOUNDS, SPANS, *[types.float64] * 2, types.int64)
def find_quiet_ground(
    image: ByteImage,
    earlier: ByteImage,
    waiting: ByteImage,
    background: FloatImage,
    deviation: ByteImage,
    valid: ByteImage,
    bounds: Bounds,
    spans: Spans,
    threshold: float,
    gradient_gain: float,
    quiet_frames: int,
) -> ByteImage:
    """Equations 1 and 2; ground that is new and did not change gets a provisional background.

    Args:
        image: uint8, f(t) on the canvas, `UNSEEN` where it shows nothing.
        earlier: uint8, f(t - tau), the same.
        waiting: uint8, the counter D; updated in place, as the next three.
        background: float32, B.
        deviation: uint8, see `ground`.
        valid: uint8, see `ground`.
        bounds: the part of the canvas that the frame covers.
        spans: int64[h, 2], the columns of each of its rows that show the frame.
        threshold: T_s, grey levels.
        gradient_gain: see `equations.find_changes`.
        quiet_frames: lambda.

    Returns:
        uint8[h, w], mask of D = 0.
    """
    top, bottom, left, right = bounds
    most, gain = np.float32(threshold), np.float32(gradient_gain)
    quiet, changed = np.zeros((bottom - top, right - left), np.uint8), np.empty(right - left, np.uint8)
    ranges, lowest, highest = np.empty_like(changed), np.empty_like(changed), np.empty_like(changed)
    for row in range(top, bottom):
        first, last = spans[row - top]
        if first == last:
            continue
        part, width = slice(first, last), slice(0, last - first)
        counters, values, before = waiting[row, part], image[row, part], earlier[row, part]
        above, below = earlier[max(row - 1, top), part], earlier[min(row + 1, bottom - 1), part]
        found, changes = ranges[width], changed[width]
        _find_ranges(above, before, below, lowest[width], highest[width], found)
        find_changes(values, before, found, most, gain, changes)
        _add_unseen(values, before, changes)
        count_down(counters, changes)
        find_quiet(counters, quiet_frames, quiet[row - top, first - left : last - left])
        if _has_new(valid[row, part], counters):
            for column in range(first, last):
                if valid[row, column] == UNKNOWN and waiting[row, column] < MAX_WAIT:
                    edge = EDGE_SHARE * np.float32(found[column - first])
                    background[row, column], valid[row, column] = earlier[row, column], PROVISIONAL
                    deviation[row, column] = np.uint8(np.rint(DEVIATION_STEPS * (FIRST_DEVIATION + edge)))
    return quiet


@compiled
def _find_ranges(
    above: ByteLine, line: ByteLine, below: ByteLine, lowest: ByteLine, highest: ByteLine, ranges: ByteLine
) -> None:
    """The range of what is seen among each pixel of a line and its neighbours.

    `lowest` and `highest` become those among a pixel and the ones above and below it.
    """
    one = np.uint8(1)
    for index in range(line.size):
        first, middle, last = above[index], line[index], below[index]
        highest[index] = max(first, middle, last)
        # One less, so that what is unseen wraps to the largest number.
        lowest[index] = min(np.uint8(first - one), np.uint8(middle - one), np.uint8(last - one))
    end = line.size - 1
    for index in range(1, end):
        most = max(highest[index - 1], highest[index], highest[index + 1])
        least = min(lowest[index - 1], lowest[index], lowest[index + 1])
        ranges[index] = np.uint8(np.uint8(most - least) - one)
    for index, other in ((0, min(1, end)), (end, max(end - 1, 0))):
        most, least = max(highest[index], highest[other]), min(lowest[index], lowest[other])
        ranges[index] = np.uint8(np.uint8(most - least) - one)


@compiled
def _add_unseen(image: ByteLine, earlier: ByteLine, changed: ByteLine) -> None:
    """What is not in both frames counts as changed."""
    for index in range(changed.size):
        changed[index] = SET if min(image[index], earlier[index]) == np.uint8(UNSEEN) else changed[index]


@compiled
def _has_new(valid: ByteLine, waiting: ByteLine) -> bool:
    """Whether a line has unknown ground that did not change."""
    united = np.uint8(0)
    for index in range(valid.size):
        is_new = (valid[index] == np.uint8(UNKNOWN)) & (waiting[index] < np.uint8(MAX_WAIT))
        united |= np.uint8(is_new)
    return bool(united > 0)


@kernel(UINT8, UINT8, FLOAT32, UINT8, BOUNDS, SPANS, types.float64, types.float64)
def find_limits(
    image: ByteImage,
    valid: ByteImage,
    background: FloatImage,
    deviation: ByteImage,
    bounds: Bounds,
    spans: Spans,
    gain: float,
    lowest: float,
) -> tuple[ByteImage, ByteImage]:
    """What a frame is compared with.

    Args:
        image: uint8, f(t) on the canvas.
        valid: uint8, see `ground`, as the other images.
        background: float32, B(t - 1).
        deviation: uint8, see `ground`.
        bounds: the part of the canvas that the frame covers.
        spans: int64[h, 2], the columns of each of its rows that show the frame.
        gain: of the threshold, in mean absolute deviations.
        lowest: smallest threshold, grey levels.

    Returns:
        uint8[h, w] each: B(t - 1) in whole grey levels; T_F of each pixel, `UNCOMPARED` where the frame shows
        nothing or the background is unknown.
    """
    top, bottom, left, right = bounds
    rounded = np.zeros((bottom - top, right - left), np.uint8)
    thresholds = np.full(rounded.shape, np.uint8(UNCOMPARED))
    times, least = np.float32(gain), np.float32(int(lowest))
    for row in range(top, bottom):
        first, last = spans[row - top]
        part, limits = slice(first, last), thresholds[row - top, first - left : last - left]
        _round(background[row, part], rounded[row - top, first - left : last - left])
        find_thresholds(deviation[row, part], times, least, limits)
        _set_uncompared(image[row, part], valid[row, part], limits)
    return rounded, thresholds


@compiled
def _round(values: FloatLine, rounded: ByteLine) -> None:
    for index in range(rounded.size):
        rounded[index] = np.uint8(np.int32(np.rint(values[index])))


@compiled
def _set_uncompared(image: ByteLine, valid: ByteLine, thresholds: ByteLine) -> None:
    for index in range(thresholds.size):
        # Both constants are 0.
        is_missing = (image[index] == np.uint8(UNSEEN)) | (valid[index] == np.uint8(UNKNOWN))
        thresholds[index] = np.uint8(UNCOMPARED) if is_missing else thresholds[index]


@kernel(UINT8, BOUNDS, SPANS, *[UINT8] * 3)
def compare_with_background(
    image: ByteImage,
    bounds: Bounds,
    spans: Spans,
    lowest: ByteImage,
    highest: ByteImage,
    thresholds: ByteImage,
) -> ByteImage:
    """Equation 4: mask, uint8[h, w], of what differs from the background beyond the tolerance.

    Args:
        image: uint8, f(t) on the canvas.
        bounds: the part of the canvas that the frame covers.
        spans: int64[h, 2], the columns of each of its rows that show the frame.
        lowest: uint8[h, w], the least value of the background within the tolerance.
        highest: uint8[h, w], the largest one.
        thresholds: uint8[h, w], see `find_limits`.
    """
    top, bottom, left, _ = bounds
    mask = np.zeros_like(thresholds)
    for line in range(bottom - top):
        first, last = spans[line]
        values, here = image[top + line, first:last], slice(first - left, last - left)
        limits = lowest[line, here], highest[line, here], thresholds[line, here]
        find_foreground_pixels(values, *limits, mask[line, here])
    return mask


@kernel(UINT8, UINT8, UINT8, BOUNDS, SPANS, UINT8, UINT8, types.float64)
def add_weak(
    mask: ByteImage,
    near: ByteImage,
    image: ByteImage,
    bounds: Bounds,
    spans: Spans,
    background: ByteImage,
    thresholds: ByteImage,
    ratio: float,
) -> None:
    """Adds what is near the foreground and differs from the background by more than a lower threshold.

    Args:
        mask: uint8[h, w], foreground; updated in place.
        near: uint8[h, w], mask of what is near it.
        image: uint8, f(t) on the canvas.
        bounds: the part of the canvas that the frame covers.
        spans: int64[h, 2], the columns of each of its rows that show the frame.
        background: uint8[h, w], B(t - 1) in whole grey levels.
        thresholds: uint8[h, w], see `find_limits`.
        ratio: lower threshold over the upper one.
    """
    top, bottom, left, _ = bounds
    for line in range(bottom - top):
        first, last = spans[line]
        here = slice(first - left, last - left)
        if has_set(near[line, here]):
            images = image[top + line, first:last], background[line, here], thresholds[line, here]
            _add_weak(*images, near[line, here], np.float32(ratio), mask[line, here])


@compiled
def _add_weak(
    image: ByteLine,
    background: ByteLine,
    thresholds: ByteLine,
    near: ByteLine,
    ratio: np.float32,
    mask: ByteLine,
) -> None:
    for index in range(mask.size):
        value, other = image[index], background[index]
        difference = np.float32(np.uint8(max(value, other) - min(value, other)))
        limit = np.rint(np.float32(thresholds[index]) * ratio)
        is_weak = (difference > limit) & (thresholds[index] < np.uint8(UNCOMPARED))
        mask[index] |= near[index] if is_weak else np.uint8(0)
