"""Learning from a frame: equation 3, stationary objects, new pixels, and the noise of each pixel."""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import REGION, ByteImage, ByteLine, FloatImage, FloatLine, Region
from streamkit_differencer.lines import clear, local_range
from streamkit_kernels import BYTES, FLOATS, compiled, kernel

# Update of a pixel's background: none, by equation 3, replaced by the frame, or its first one.
NONE, AVERAGED, REPLACED, NEW = 0, 1, 2, 3
# Blocks without new pixels are skipped.
BLOCK_ROWS, BLOCK_PX = 16, 64


@kernel(BYTES, BYTES, BYTES, FLOATS, BYTES, BYTES, BYTES, REGION, types.float64, types.int64)
def learn(
    image: ByteImage,
    mask: ByteImage,
    quiet: ByteImage,
    background: FloatImage,
    valid: ByteImage,
    standing: ByteImage,
    updates: ByteImage,
    region: Region,
    learning_rate: float,
    absorb_frames: int,
) -> int:
    """Equation 3; foreground that was quiet long enough, and new quiet pixels, become background.

    Args:
        image: uint8[h, w], f(t) on the canvas, as all images.
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of D = 0.
        background: float32[h, w], B(t - 1), becomes B(t).
        valid: uint8[h, w], mask of where it is known; updated in place.
        standing: uint8[h, w], frames that a pixel was foreground and quiet; updated in place.
        updates: uint8[h, w], output: `NONE`, `AVERAGED`, `REPLACED` or `NEW`.
        region: bounds of the frame; nothing else is read or written.
        learning_rate: alpha, 0 to 1.
        absorb_frames: frames after which a stationary object becomes background.

    Returns:
        The number of new pixels.
    """
    top, bottom, left, right = region
    least, total = np.uint8(min(max(absorb_frames, 0), 255)), 0
    for row in range(top, bottom):
        counts, update = standing[row, left:right], updates[row, left:right]
        line_quiet, known = quiet[row, left:right], valid[row, left:right]
        _count_standing(mask[row, left:right], line_quiet, counts)
        _choose_updates(mask[row, left:right], line_quiet, known, counts, least, update)
        _apply(image[row, left:right], update, np.float32(learning_rate), background[row, left:right])
        _accept(update, known)
        if _has_new(update):
            total += _count_new(update)
    return total


@compiled
def _count_standing(mask: ByteLine, quiet: ByteLine, standing: ByteLine) -> None:
    """Counts frames, to 255; 0 where a pixel is not foreground."""
    for index in range(standing.size):
        count = standing[index] & mask[index]
        still = mask[index] & quiet[index] & np.uint8(1)
        standing[index] = np.uint8(count + min(still, np.uint8(~count)))


@compiled
def _choose_updates(
    mask: ByteLine, quiet: ByteLine, valid: ByteLine, standing: ByteLine, least: np.uint8, update: ByteLine
) -> None:
    for index in range(update.size):
        is_long = standing[index] >= least
        for_foreground = np.uint8(REPLACED) if is_long else np.uint8(NONE)
        is_known = valid[index] == np.uint8(255)
        for_background = np.uint8(AVERAGED) if is_known else np.uint8(NEW)
        kind = for_foreground if mask[index] > 0 and is_known else for_background
        update[index] = kind & quiet[index]


@compiled
def _accept(update: ByteLine, valid: ByteLine) -> None:
    """Makes new pixels valid."""
    for index in range(update.size):
        is_new = update[index] == np.uint8(NEW)
        valid[index] = valid[index] | (np.uint8(255) if is_new else np.uint8(0))


@compiled
def _has_new(update: ByteLine) -> bool:
    largest = np.uint8(NONE)
    for index in range(update.size):
        largest = max(largest, update[index])
    return bool(largest == np.uint8(NEW))


@compiled
def _count_new(update: ByteLine) -> int:
    count = np.int32(0)
    for index in range(update.size):
        count += np.int32(update[index] == np.uint8(NEW))
    return int(count)


@compiled
def _apply(line: ByteLine, update: ByteLine, learning_rate: np.float32, background: FloatLine) -> None:
    one, none = np.float32(1.0), np.float32(0.0)
    for index in range(line.size):
        kind = update[index]
        weight = (
            learning_rate if kind == np.uint8(AVERAGED) else (one if kind >= np.uint8(REPLACED) else none)
        )
        background[index] = background[index] * (one - weight) + np.float32(line[index]) * weight


@kernel(BYTES, BYTES, BYTES, FLOATS, BYTES, REGION, types.float64, types.float64, types.int64, types.int64)
def learn_noise(
    image: ByteImage,
    rounded: ByteImage,
    updates: ByteImage,
    deviation: FloatImage,
    thresholds: ByteImage,
    region: Region,
    learning_rate: float,
    gain: float,
    lowest: int,
    highest: int,
) -> None:
    """Learns the mean absolute deviation of averaged pixels, as a running mean, and their thresholds.

    Args:
        image: uint8[h, w], f(t) on the canvas, as all images.
        rounded: uint8[h, w], B(t - 1).
        updates: uint8[h, w], see `learn`.
        deviation: float32[h, w], grey levels; updated in place.
        thresholds: uint8[h, w], T_F of each pixel, updated in place; the old one limits what a missed object
            adds to the deviation.
        region: bounds of the frame.
        learning_rate: weight of this frame, 0 to 1.
        gain: threshold over mean deviation.
        lowest: smallest threshold, grey levels.
        highest: largest threshold.
    """
    top, bottom, left, right = region
    for row in range(top, bottom):
        deviations, limits = deviation[row, left:right], thresholds[row, left:right]
        line, background, update = image[row, left:right], rounded[row, left:right], updates[row, left:right]
        _average_deviation(line, background, update, limits, np.float32(learning_rate), deviations)
        _set_thresholds(deviations, limits, gain, lowest, highest)


@compiled
def _average_deviation(
    line: ByteLine,
    background: ByteLine,
    update: ByteLine,
    thresholds: ByteLine,
    learning_rate: np.float32,
    deviation: FloatLine,
) -> None:
    one, none = np.float32(1.0), np.float32(0.0)
    for index in range(line.size):
        value, other = line[index], background[index]
        current = np.float32(min(np.uint8(max(value, other) - min(value, other)), thresholds[index]))
        weight = learning_rate if update[index] == np.uint8(AVERAGED) else none
        deviation[index] = deviation[index] * (one - weight) + current * weight


@compiled
def _set_thresholds(
    deviation: FloatLine, thresholds: ByteLine, gain: float, lowest: int, highest: int
) -> None:
    factor, least, most = np.float32(gain), np.float32(lowest), np.float32(highest)
    for index in range(deviation.size):
        value = max(min(np.rint(deviation[index] * factor), most), least)
        thresholds[index] = np.uint8(np.int32(value))


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
    """Initialises the noise of new pixels, from the local range of an earlier frame.

    Args:
        earlier: uint8[h, w], f(t - tau) on the canvas, as all images.
        updates: uint8[h, w], see `learn`.
        deviation: float32[h, w], mean absolute deviation, grey levels; set at new pixels.
        thresholds: uint8[h, w], T_F; set there, too.
        region: bounds of the frame.
        first: deviation of a pixel whose background is a single frame.
        edge: share of the local range that is added to it.
        gain: threshold over mean deviation.
        lowest: smallest threshold, grey levels.
        highest: largest threshold.
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
                        initial_noise(earlier, row, column, region, deviation, thresholds, limits)


@compiled
def initial_noise(
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
    limit = min(np.rint(rough * np.float32(gain)), np.float32(highest))
    thresholds[row, column] = np.uint8(np.int32(max(limit, np.float32(lowest))))


@compiled
def _maximum(update: ByteLine, largest: ByteLine) -> None:
    for index in range(update.size):
        largest[index] = max(largest[index], update[index])
