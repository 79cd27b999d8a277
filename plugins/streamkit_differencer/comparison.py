"""A frame compared with an earlier one and with the background, pixel by pixel, on the canvas."""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import BOUNDS, Bounds, ByteImage, ByteLine, FloatImage, FloatLine
from streamkit_differencer.equations import (
    MAX_WAIT,
    SET,
    count_down,
    find_changes,
    find_foreground_pixels,
    find_quiet,
)
from streamkit_differencer.ground import PROVISIONAL, UNKNOWN
from streamkit_differencer.noise import EDGE_SHARE, FIRST_DEVIATION, find_thresholds
from streamkit_kernels import FLOAT32, UINT8, compiled, kernel


@kernel(*[UINT8] * 6, FLOAT32, FLOAT32, UINT8, BOUNDS, *[types.float64] * 2, types.int64)
def find_quiet_ground(
    image: ByteImage,
    seen: ByteImage,
    earlier: ByteImage,
    earlier_seen: ByteImage,
    ranges: ByteImage,
    waiting: ByteImage,
    background: FloatImage,
    deviation: FloatImage,
    valid: ByteImage,
    bounds: Bounds,
    threshold: float,
    gradient_gain: float,
    quiet_frames: int,
) -> ByteImage:
    """Equations 1 and 2; ground that is new and did not change gets a provisional background.

    Args:
        image: uint8, f(t) on the canvas, as all images but `ranges`.
        seen: uint8, mask of what it covers.
        earlier: uint8, f(t - tau).
        earlier_seen: uint8, mask of what that covers.
        ranges: uint8[h, w], the local range of `earlier` within the bounds.
        waiting: uint8, the counter D; updated in place, as the next three.
        background: float32, B.
        deviation: float32, see `noise`.
        valid: uint8, see `ground`.
        bounds: the part of the canvas that the frame covers.
        threshold: T_s, grey levels.
        gradient_gain: see `equations.find_changes`.
        quiet_frames: lambda.

    Returns:
        uint8[h, w], mask of D = 0.
    """
    top, bottom, left, right = bounds
    most, gain = np.float32(threshold), np.float32(gradient_gain)
    quiet, changed = np.empty((bottom - top, right - left), np.uint8), np.empty(right - left, np.uint8)
    for row in range(top, bottom):
        counters = waiting[row, left:right]
        find_changes(image[row, left:right], earlier[row, left:right], ranges[row - top], most, gain, changed)
        _add_unseen(seen[row, left:right], earlier_seen[row, left:right], changed)
        count_down(counters, changed)
        find_quiet(counters, quiet_frames, quiet[row - top])
        if _has_new(valid[row, left:right], counters):
            for column in range(left, right):
                if valid[row, column] == UNKNOWN and waiting[row, column] < MAX_WAIT:
                    edge = EDGE_SHARE * np.float32(ranges[row - top, column - left])
                    background[row, column], valid[row, column] = earlier[row, column], PROVISIONAL
                    deviation[row, column] = FIRST_DEVIATION + edge
    return quiet


@compiled
def _add_unseen(seen: ByteLine, earlier_seen: ByteLine, changed: ByteLine) -> None:
    """What is not in both frames counts as changed."""
    for index in range(changed.size):
        changed[index] |= (seen[index] & earlier_seen[index]) ^ SET


@compiled
def _has_new(valid: ByteLine, waiting: ByteLine) -> bool:
    """Whether a line has unknown ground that did not change."""
    united = np.uint8(0)
    for index in range(valid.size):
        is_new = (valid[index] == np.uint8(UNKNOWN)) & (waiting[index] < np.uint8(MAX_WAIT))
        united |= np.uint8(is_new)
    return bool(united > 0)


@kernel(UINT8, UINT8, FLOAT32, FLOAT32, BOUNDS, types.float64, types.float64)
def known_background(
    seen: ByteImage,
    valid: ByteImage,
    background: FloatImage,
    deviation: FloatImage,
    bounds: Bounds,
    gain: float,
    lowest: float,
) -> tuple[ByteImage, ByteImage, ByteImage]:
    """What a frame is compared with.

    Args:
        seen: uint8, mask of what the frame covers on the canvas.
        valid: uint8, see `ground`, as the other images.
        background: float32, B(t - 1).
        deviation: float32, mean absolute deviation of each pixel.
        bounds: the part of the canvas that the frame covers.
        gain: of the threshold, in mean absolute deviations.
        lowest: smallest threshold, grey levels.

    Returns:
        uint8[h, w] each: B(t - 1) in whole grey levels; T_F of each pixel; the mask of the pixels that the
        frame covers and whose background is known.
    """
    top, bottom, left, right = bounds
    rounded = np.empty((bottom - top, right - left), np.uint8)
    thresholds, known = np.empty_like(rounded), np.empty_like(rounded)
    times, least = np.float32(gain), np.float32(int(lowest))
    for row in range(top, bottom):
        _round(background[row, left:right], rounded[row - top])
        find_thresholds(deviation[row, left:right], times, least, thresholds[row - top])
        _find_known(seen[row, left:right], valid[row, left:right], known[row - top])
    return rounded, thresholds, known


@compiled
def _round(values: FloatLine, rounded: ByteLine) -> None:
    for index in range(rounded.size):
        rounded[index] = np.uint8(np.int32(np.rint(values[index])))


@compiled
def _find_known(seen: ByteLine, valid: ByteLine, known: ByteLine) -> None:
    for index in range(known.size):
        known[index] = seen[index] if valid[index] > np.uint8(UNKNOWN) else np.uint8(0)


@kernel(UINT8, BOUNDS, *[UINT8] * 5, types.float64)
def compare_with_background(
    image: ByteImage,
    bounds: Bounds,
    background: ByteImage,
    lowest: ByteImage,
    highest: ByteImage,
    thresholds: ByteImage,
    known: ByteImage,
    hysteresis_ratio: float,
) -> tuple[ByteImage, ByteImage]:
    """Equation 4 with two thresholds.

    Args:
        image: uint8, f(t) on the canvas.
        bounds: the part of the canvas that the frame covers.
        background: uint8[h, w], B(t - 1) in whole grey levels, of that part, as what follows.
        lowest: uint8[h, w], the least value of the background within the tolerance.
        highest: uint8[h, w], the largest one.
        thresholds: uint8[h, w], T_F of each pixel.
        known: uint8[h, w], mask of the pixels that may be foreground.
        hysteresis_ratio: lower threshold over the upper one.

    Returns:
        uint8[h, w] each: mask of known pixels that differ from the background beyond the tolerance by more
        than the threshold; mask of all that differ from the background itself by more than the lower one.
    """
    top, bottom, left, right = bounds
    strong, weak = np.empty_like(background), np.empty_like(background)
    ratio = np.float32(hysteresis_ratio)
    for line in range(bottom - top):
        values = image[top + line, left:right]
        find_foreground_pixels(values, lowest[line], highest[line], thresholds[line], strong[line])
        _find_weak(values, background[line], thresholds[line], ratio, weak[line])
        _keep(known[line], strong[line])
    return strong, weak


@compiled
def _find_weak(
    image: ByteLine,
    background: ByteLine,
    thresholds: ByteLine,
    ratio: np.float32,
    weak: ByteLine,
) -> None:
    for index in range(weak.size):
        value, other = image[index], background[index]
        difference = np.float32(np.uint8(max(value, other) - min(value, other)))
        limit = np.rint(np.float32(thresholds[index]) * ratio)
        weak[index] = SET if difference > limit else np.uint8(0)


@compiled
def _keep(mask: ByteLine, line: ByteLine) -> None:
    for index in range(line.size):
        line[index] &= mask[index]
