"""Learning from a frame: equation 3, stationary objects and new pixels.

Besides its background a pixel keeps the other value that it shows, and for how many frames it was seen at
rest with each. The other value becomes the background after as many frames as the background was known for,
at most `absorb_frames`: a ghost of the first frames goes soon, a vehicle that stops stays. The old background
then is the other value, and is known again when the vehicle leaves.

A provisional background competes frame by frame: ground behind leaves is seldom at rest, but always shows the
same value, and leaves show many. Where the other value was seen in more frames, it takes its place.

Source: the candidate and apparent background of Yi et al., "Detection of Moving Objects with Non-stationary
    Cameras in 5.8ms", CVPR Workshops 2013, for single pixels.
"""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import REGION, ByteImage, ByteLine, FloatImage, FloatLine, Region
from streamkit_differencer.lines import is_any_set
from streamkit_kernels import BYTES, FLOATS, compiled, kernel

# Update of a pixel's background: none, by equation 3, replaced by the frame, or its first one.
NONE, AVERAGED, REPLACED, NEW = 0, 1, 2, 3
# Value of `valid` where the background is provisional; a mask for the levels of `pixel_classes.classify`.
PROVISIONAL = 3
# Frames for which the other value of a provisional background still follows small changes.
SETTLING_FRAMES = 3


@kernel(*[BYTES] * 3, FLOATS, *[BYTES] * 7, REGION, types.float64, *[types.int64] * 4)
def learn(
    image: ByteImage,
    mask: ByteImage,
    quiet: ByteImage,
    background: FloatImage,
    rounded: ByteImage,
    thresholds: ByteImage,
    valid: ByteImage,
    known_frames: ByteImage,
    other: ByteImage,
    other_frames: ByteImage,
    updates: ByteImage,
    region: Region,
    learning_rate: float,
    quiet_frames: int,
    absorb_frames: int,
    same: int,
    fewest: int,
) -> int:
    """Equation 3; foreground that was seen long enough, and new quiet pixels, become background.

    Args:
        image: uint8[h, w], f(t) on the canvas, as all images.
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of D = 0.
        background: float32[h, w], B(t - 1), becomes B(t).
        rounded: uint8[h, w], B(t - 1) in whole grey levels.
        thresholds: uint8[h, w], T_F of each pixel: values that differ by no more are the same.
        valid: uint8[h, w], mask of where the background is known; updated in place.
        known_frames: uint8[h, w], frames that the background was seen at rest; updated in place.
        other: uint8[h, w], the other value of each pixel; updated in place.
        other_frames: uint8[h, w], frames that it was seen at rest; updated in place.
        updates: uint8[h, w], output: `NONE`, `AVERAGED`, `REPLACED` or `NEW`.
        region: bounds of the frame; nothing else is read or written.
        learning_rate: alpha, 0 to 1.
        quiet_frames: lambda, the frames that new background was seen at rest.
        absorb_frames: frames after which a stationary object becomes background at the latest.
        same: largest difference of values that are the same to a provisional background, grey levels.
        fewest: frames in which the value that replaces a provisional background was seen, at least.

    Returns:
        The number of new pixels.
    """
    top, bottom, left, right = region
    most, total = np.uint8(min(max(absorb_frames, 0), 255)), 0
    first, limits = np.uint8(quiet_frames), (np.uint8(same), np.uint8(fewest))
    for row in range(top, bottom):
        line, foreground, update = image[row, left:right], mask[row, left:right], updates[row, left:right]
        line_quiet, known = quiet[row, left:right], valid[row, left:right]
        frames = known_frames[row, left:right]
        _choose_updates(foreground, line_quiet, known, update)
        states = line, foreground, known, line_quiet, rounded[row, left:right], thresholds[row, left:right]
        others = other[row, left:right], other_frames[row, left:right]
        if is_any_set(foreground):
            _count_other(*states, most, frames, *others, update)
        if _has_provisional(known):
            _compete(*states, *limits, first, frames, *others, update)
        _apply(line, update, np.float32(learning_rate), background[row, left:right])
        _accept(update, known, frames, first)
        total += _count_new(update)
    return total


@compiled
def _choose_updates(mask: ByteLine, quiet: ByteLine, valid: ByteLine, update: ByteLine) -> None:
    for index in range(update.size):
        is_known = valid[index] == np.uint8(255)
        for_foreground = np.uint8(NONE) if is_known else np.uint8(NEW)
        for_background = np.uint8(AVERAGED) if is_known else np.uint8(NEW)
        kind = for_foreground if mask[index] > 0 else for_background
        update[index] = kind & quiet[index]


@compiled
def _count_other(
    line: ByteLine,
    mask: ByteLine,
    valid: ByteLine,
    quiet: ByteLine,
    rounded: ByteLine,
    thresholds: ByteLine,
    most: np.uint8,
    known_frames: ByteLine,
    other: ByteLine,
    other_frames: ByteLine,
    update: ByteLine,
) -> None:
    """Counts the frames of the other value of foreground, up while it rests and down while it does not show.

    A value without frames left is replaced, and one with as many as the background becomes the background.
    """
    one, none = np.uint8(1), np.uint8(0)
    for index in range(update.size):
        value, before, count, known = line[index], other[index], other_frames[index], known_frames[index]
        is_foreground = mask[index] > none and valid[index] == np.uint8(255)
        is_like = np.uint8(max(value, before) - min(value, before)) <= thresholds[index]
        more = np.uint8(count + min(quiet[index] & one, np.uint8(~count)))
        less = np.uint8(count - min(count, one))
        begins = not is_like and less == none
        count = (more if is_like else less) if is_foreground else count
        is_shown = is_foreground and quiet[index] > none and (is_like or begins)
        exchanges = is_shown and count >= min(known, most)
        update[index] = np.uint8(REPLACED) if exchanges else update[index]
        known_frames[index] = count if exchanges else known
        other_frames[index] = known if exchanges else count
        kept = value if is_foreground and begins else before
        other[index] = rounded[index] if exchanges else kept


@compiled
def _has_provisional(valid: ByteLine) -> bool:
    is_any = np.uint8(0)
    for index in range(valid.size):
        is_any |= np.uint8(valid[index] == np.uint8(PROVISIONAL))
    return bool(is_any)


@compiled
def _compete(
    line: ByteLine,
    mask: ByteLine,
    valid: ByteLine,
    quiet: ByteLine,
    rounded: ByteLine,
    thresholds: ByteLine,
    same: np.uint8,
    fewest: np.uint8,
    quiet_frames: np.uint8,
    known_frames: ByteLine,
    other: ByteLine,
    other_frames: ByteLine,
    update: ByteLine,
) -> None:
    """Counts the frames of provisional background and of its other value; the one seen more often stays."""
    one, none = np.uint8(1), np.uint8(0)
    for index in range(update.size):
        if valid[index] != np.uint8(PROVISIONAL):
            continue
        value, here, count = line[index], rounded[index], other_frames[index]
        limit = min(thresholds[index], same)
        if np.uint8(max(value, here) - min(value, here)) <= limit:
            known_frames[index] += min(one, np.uint8(~known_frames[index]))
            other_frames[index] = count - min(count, one)
            continue
        is_like = np.uint8(max(value, other[index]) - min(value, other[index])) <= limit
        begins = not is_like and count <= one
        other[index] = value if begins or (is_like and count <= SETTLING_FRAMES) else other[index]
        more = np.uint8(count + min(one, np.uint8(~count)))
        count = one if begins else (more if is_like else np.uint8(count - one))
        other_frames[index] = count
        if mask[index] == none:
            continue
        # What is quiet was there for quiet_frames.
        count = max(count, quiet_frames) if quiet[index] > none else count
        is_shown = is_like or begins or quiet[index] > none
        if is_shown and count > known_frames[index] and count >= fewest:
            update[index] = max(update[index], np.uint8(REPLACED))
            other[index], other_frames[index] = here, known_frames[index]
            known_frames[index] = count
        else:
            update[index] = np.uint8(NONE)


@compiled
def _accept(update: ByteLine, valid: ByteLine, frames: ByteLine, first: np.uint8) -> None:
    """Makes new pixels valid, and counts the frames of what is background."""
    for index in range(update.size):
        is_new, count = update[index] == np.uint8(NEW), frames[index]
        known = count if valid[index] > np.uint8(0) else np.uint8(0)
        valid[index] = valid[index] | (np.uint8(255) if is_new else np.uint8(0))
        more = np.uint8(count + min(np.uint8(update[index] == np.uint8(AVERAGED)), np.uint8(~count)))
        frames[index] = max(first, known) if is_new else more


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
