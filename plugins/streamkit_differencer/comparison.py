"""A frame compared with an earlier one and with the background, pixel by pixel, on the canvas."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from streamkit_differencer.arrays import (
    ByteImage,
    ByteLine,
    FloatLine,
    find_set,
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
from streamkit_differencer.ground import (
    CANVAS_FRAME,
    DEVIATION_STEPS,
    GROUND,
    PROVISIONAL,
    UNKNOWN,
    UNSEEN,
    CanvasFrame,
    Ground,
)
from streamkit_differencer.noise import EDGE_SHARE, FIRST_DEVIATION, find_thresholds
from streamkit_kernels import UINT8, compiled, kernel, named_tuple

# Threshold of pixels that are not compared: no difference exceeds it.
UNCOMPARED = 255


class Comparison(NamedTuple):
    """A frame compared with the background, on the part of the canvas that it covers; uint8[h, w] each.

    Attributes:
        background: B(t - 1), in whole grey levels.
        thresholds: T_F of each pixel: a multiple of its deviation, within limits; `UNCOMPARED` where the
            frame shows nothing or the background is unknown.
        quiet: mask of the pixels that did not change within `quiet_frames`.
        mask: foreground, values of a finished mask once it is learnt.
        follows_exposure: whether the background was adapted to a change of brightness.
    """

    background: ByteImage
    thresholds: ByteImage
    quiet: ByteImage
    mask: ByteImage
    follows_exposure: bool


COMPARISON = named_tuple(Comparison, *[UINT8] * 4, types.boolean)


@kernel(CANVAS_FRAME, UINT8, GROUND, types.float64, types.float64, types.int64)
def find_quiet_ground(
    frame: CanvasFrame,
    earlier: ByteImage,
    ground: Ground,
    threshold: float,
    gradient_gain: float,
    quiet_frames: int,
) -> ByteImage:
    """Equations 1 and 2; ground that is new and did not change gets a provisional background.

    Args:
        frame: f(t).
        earlier: uint8, f(t - tau) on the canvas, `UNSEEN` where it shows nothing.
        ground: its counter D is updated in place; background, deviation and validity where it is new.
        threshold: T_s, grey levels.
        gradient_gain: share of the local range of `earlier` that is added to the threshold, so that a
            registration error at an edge is no change; 0 gives the paper's equation.
        quiet_frames: lambda.

    Returns:
        uint8[h, w], mask of D = 0.
    """
    top, bottom, left, right = frame.bounds
    most, gain = np.uint8(min(threshold, 255.0)), np.float32(gradient_gain)
    quiet, changed = np.zeros((bottom - top, right - left), np.uint8), np.empty(right - left, np.uint8)
    columns, ranges = np.empty(right - left, np.int64), np.empty(right - left, np.uint8)
    extremes = np.empty((2, right - left + 2), np.uint8)
    for row in range(top, bottom):
        first, last = frame.spans[row - top]
        part, around = slice(first, last), earlier[max(row - 1, top) : min(row + 2, bottom), first:last]
        counters, values, before = ground.waiting[row, part], frame.image[row, part], earlier[row, part]
        changes = changed[: last - first]
        find_changes(values, before, most, changes)
        if gain > 0.0:
            _mark_unseen(values, before, np.uint8(0), changes)
            count = find_set(changes, columns)
            if count > 0:
                _find_ranges(around[0], before, around[-1], extremes, ranges)
            for column in columns[:count]:
                difference = np.float32(abs(np.int64(values[column]) - np.int64(before[column])))
                if np.rint(difference - gain * np.float32(ranges[column])) <= np.float32(threshold):
                    changes[column] = 0
        _mark_unseen(values, before, SET, changes)
        count_down(counters, changes)
        find_quiet(counters, quiet_frames, quiet[row - top, first - left : last - left])
        _find_new(ground.valid[row, part], counters, changes)
        count = find_set(changes, columns)
        if count > 0:
            _find_ranges(around[0], before, around[-1], extremes, ranges)
        for column in columns[:count]:
            here, deviation = first + column, FIRST_DEVIATION + EDGE_SHARE * np.float32(ranges[column])
            ground.background[row, here] = before[column]
            ground.deviation[row, here] = np.uint8(np.rint(DEVIATION_STEPS * deviation))
            ground.valid[row, here] = PROVISIONAL
    return quiet


@compiled
def _find_ranges(
    above: ByteLine, line: ByteLine, below: ByteLine, extremes: ByteImage, ranges: ByteLine
) -> None:
    """The range of what is seen among each pixel of a line and its neighbours in the three lines.

    Args:
        above: uint8[w], as the next two; the first and the last line repeat the line itself.
        line: the line.
        below: the same.
        extremes: uint8[2, w + 2 or more], is overwritten.
        ranges: uint8[w or more], becomes the ranges.
    """
    lowest, highest, unit = extremes[0], extremes[1], np.uint8(1)
    for index in range(line.size):
        # What is unseen, 0, wraps to the largest number.
        low = min(np.uint8(above[index] - unit), np.uint8(line[index] - unit))
        lowest[index + 1] = min(low, np.uint8(below[index] - unit))
        highest[index + 1] = max(above[index], line[index], below[index])
    lowest[0] = lowest[line.size + 1] = 255
    highest[0] = highest[line.size + 1] = UNSEEN
    for index in range(line.size):
        low = min(lowest[index], lowest[index + 1], lowest[index + 2])
        high = max(highest[index], highest[index + 1], highest[index + 2])
        ranges[index] = np.uint8(high - np.uint8(low + unit))


@compiled
def _mark_unseen(image: ByteLine, earlier: ByteLine, mark: np.uint8, changed: ByteLine) -> None:
    """Marks what is not in both frames; in the end it counts as changed."""
    for index in range(changed.size):
        changed[index] = mark if min(image[index], earlier[index]) == np.uint8(UNSEEN) else changed[index]


@compiled
def _find_new(valid: ByteLine, waiting: ByteLine, new: ByteLine) -> None:
    """Unknown ground of a line that did not change."""
    for index in range(new.size):
        is_new = (valid[index] == np.uint8(UNKNOWN)) & (waiting[index] < np.uint8(MAX_WAIT))
        new[index] = SET if is_new else np.uint8(0)


@kernel(CANVAS_FRAME, GROUND, types.float64, types.float64, types.int64)
def compare_with_background(
    frame: CanvasFrame, ground: Ground, gain: float, lowest: float, tolerance: int
) -> tuple[ByteImage, ByteImage, ByteImage]:
    """Equation 4, with a threshold for each pixel and a tolerance.

    Args:
        frame: f(t).
        ground: at t - 1.
        gain: of the threshold, in mean absolute deviations.
        lowest: smallest threshold, grey levels.
        tolerance: registration error to tolerate, px: what lies between the least and the largest value of
            the background in a square that reaches so far does not differ.

    Returns:
        Background, thresholds and foreground, see `Comparison`.
    """
    top, bottom, left, right = frame.bounds
    rounded = np.zeros((bottom - top, right - left), np.uint8)
    mask, thresholds = np.zeros_like(rounded), np.full(rounded.shape, np.uint8(UNCOMPARED))
    times, least = np.float32(gain), np.float32(int(lowest))
    for row in range(top, bottom):
        first, last = frame.spans[row - top]
        part, here = slice(first, last), slice(first - left, last - left)
        values, known, limits = frame.image[row, part], rounded[row - top, here], thresholds[row - top, here]
        _round(ground.background[row, part], known)
        find_thresholds(ground.deviation[row, part], times, least, limits)
        _set_uncompared(values, ground.valid[row, part], limits)
        find_foreground_pixels(values, known, limits, mask[row - top, here])
    if tolerance > 0:
        columns = np.empty(right - left, np.int64)
        for line in range(bottom - top):
            # What differs from the range differs from the pixel, too.
            for column in columns[: find_set(mask[line], columns)]:
                value, limit = frame.image[top + line, left + column], thresholds[line, column]
                if not _differs(value, rounded, line, column, tolerance, limit):
                    mask[line, column] = 0
    return rounded, thresholds, mask


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


@compiled
def _differs(
    value: np.uint8, background: ByteImage, row: int, column: int, tolerance: int, threshold: np.uint8
) -> bool:
    """Whether a value differs from the range of the background around a pixel by more than a threshold."""
    lowest, highest = np.int64(background[row, column]), np.int64(background[row, column])
    for y in range(max(row - tolerance, 0), min(row + tolerance + 1, background.shape[0])):
        for x in range(max(column - tolerance, 0), min(column + tolerance + 1, background.shape[1])):
            near = np.int64(background[y, x])
            lowest, highest = min(lowest, near), max(highest, near)
    excess = max(np.int64(value) - highest, lowest - np.int64(value))
    return bool(excess > np.int64(threshold))


@kernel(UINT8, UINT8, CANVAS_FRAME, UINT8, UINT8, types.float64)
def add_weak(
    mask: ByteImage,
    near: ByteImage,
    frame: CanvasFrame,
    background: ByteImage,
    thresholds: ByteImage,
    ratio: float,
) -> None:
    """Adds what is near the foreground and differs from the background by more than a lower threshold.

    Args:
        mask: uint8[h, w], foreground; updated in place.
        near: uint8[h, w], mask of what is near it.
        frame: f(t).
        background: uint8[h, w], B(t - 1) in whole grey levels.
        thresholds: uint8[h, w], see `Comparison`.
        ratio: lower threshold over the upper one.
    """
    top, bottom, left, _ = frame.bounds
    for line in range(bottom - top):
        first, last = frame.spans[line]
        here = slice(first - left, last - left)
        if has_set(near[line, here]):
            images = frame.image[top + line, first:last], background[line, here], thresholds[line, here]
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
