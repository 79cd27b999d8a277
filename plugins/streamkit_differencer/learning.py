"""What a frame teaches: equation 3, the noise of each pixel, and the choice between two values of a pixel.

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

from typing import NamedTuple

import numpy as np
from numba import types

from streamkit_differencer.arrays import ByteImage, ByteLine, CountLine, FloatLine, Indices, find_set
from streamkit_differencer.comparison import COMPARISON, Comparison
from streamkit_differencer.equations import SET, find_changes, update_background
from streamkit_differencer.foreground import STOPPED
from streamkit_differencer.ground import (
    CANVAS_FRAME,
    GROUND,
    KNOWN,
    PROVISIONAL,
    UNKNOWN,
    UNSEEN,
    CanvasFrame,
    Ground,
)
from streamkit_differencer.noise import find_measured, learn_noise
from streamkit_kernels import UINT8, compiled, kernel, named_tuple

# Frames are counted up to this, or up to `absorb_frames` if that is more.
MAX_FRAMES = 255
# Of a line of the frame: foreground, D = 0, B(t - 1) in whole grey levels, and T_F.
Marks = tuple[ByteLine, ByteLine, ByteLine, ByteLine]


class Rates(NamedTuple):
    """Weights of a frame.

    Attributes:
        background: alpha.
        noise: in the noise of known background.
        restless: in the noise of ground that was never quiet.
    """

    background: float
    noise: float
    restless: float


class Limits(NamedTuple):
    """When a value is background.

    Attributes:
        quiet_frames: lambda, the frames that quiet pixels were seen at rest.
        absorb_frames: frames after which a stationary object becomes background at the latest.
        same: largest difference of values that are the same to a provisional background, grey levels.
        min_frames: frames in which the value that replaces such a background was seen.
    """

    quiet_frames: int
    absorb_frames: int
    same: int
    min_frames: int


RATES = named_tuple(Rates, *[types.float64] * 3)
LIMITS = named_tuple(Limits, *[types.int64] * 4)


@kernel(CANVAS_FRAME, UINT8, COMPARISON, GROUND, RATES, LIMITS)
def learn(
    frame: CanvasFrame, previous: ByteImage, found: Comparison, ground: Ground, rates: Rates, limits: Limits
) -> None:
    """Learns a frame: equation 3, noise, and the values of pixels that are foreground or not yet known.

    Args:
        frame: f(t).
        previous: uint8, f(t - 1) on the canvas, `UNSEEN` where it shows nothing.
        found: the frame compared with the ground; values that differ by no more than T_F are the same. What
            is quiet of its foreground becomes `STOPPED`.
        ground: updated in place, all but its counter D; quiet pixels become known.
        rates: weights of the frame.
        limits: when a value is background.
    """
    top, bottom, left, right = frame.bounds
    alpha, noise_rates = np.float32(rates.background), (np.float32(rates.noise), np.float32(rates.restless))
    averaged, columns = np.empty(right - left, np.uint8), np.empty(right - left, np.int64)
    is_open, noisy = np.empty_like(averaged), np.empty_like(averaged)
    for row in range(top, bottom):
        line, (first, last) = row - top, frame.spans[row - top]
        part, here, size = slice(first, last), slice(first - left, last - left), slice(0, last - first)
        values, background, rounded = (
            frame.image[row, part],
            ground.background[row, part],
            found.background[line, here],
        )
        marks = found.mask[line, here], found.quiet[line, here], rounded, found.thresholds[line, here]
        states, frames = ground.valid[row, part], ground.known_frames[row, part]
        known, candidates = averaged[size], is_open[size]
        _find_averaged(marks[0], marks[1], states, known)
        update_background(background, values, known, alpha)
        measured = noisy[size]
        find_measured(values, previous[row, part], measured)
        noise = ground.deviation[row, part]
        learn_noise(values, rounded, measured, known, marks[0], states, noise_rates, noise)
        # The test of equation 2, against the background: what shows another value than that.
        find_changes(values, rounded, np.uint8(limits.same), candidates)
        _add_provisional(values, states, candidates, known)
        _find_open(values, marks[0], marks[1], states, candidates)
        _count(known, frames)
        chosen, other = columns[: find_set(candidates, columns)], ground.other[row, part]
        others = other, ground.other_frames[row, part]
        _choose(chosen, values, marks, background, states, frames, *others, limits)


@compiled
def _find_averaged(mask: ByteLine, quiet: ByteLine, valid: ByteLine, averaged: ByteLine) -> None:
    """Known background at rest."""
    for index in range(averaged.size):
        is_known = (valid[index] == np.uint8(KNOWN)) & (mask[index] == np.uint8(0))
        averaged[index] = quiet[index] if is_known else np.uint8(0)


@compiled
def _add_provisional(image: ByteLine, valid: ByteLine, differs: ByteLine, shown: ByteLine) -> None:
    """Adds what shows its provisional value."""
    for index in range(shown.size):
        is_provisional = SET if valid[index] == np.uint8(PROVISIONAL) else np.uint8(0)
        is_seen = SET if image[index] > np.uint8(UNSEEN) else np.uint8(0)
        shown[index] |= is_provisional & (differs[index] ^ SET) & is_seen


@compiled
def _find_open(image: ByteLine, mask: ByteLine, quiet: ByteLine, valid: ByteLine, differs: ByteLine) -> None:
    """The pixels to choose a value for; `differs` becomes their mask.

    They are foreground, quiet ground that is not known, and ground that differs from its provisional value.
    """
    for index in range(differs.size):
        is_unknown = SET if valid[index] != np.uint8(KNOWN) else np.uint8(0)
        is_provisional = SET if valid[index] == np.uint8(PROVISIONAL) else np.uint8(0)
        is_seen = SET if image[index] > np.uint8(UNSEEN) else np.uint8(0)
        decides = mask[index] | (quiet[index] & is_unknown) | (is_provisional & differs[index])
        differs[index] = decides & is_seen


@compiled
def _count(mask: ByteLine, frames: CountLine) -> None:
    for index in range(mask.size):
        more = np.uint16(frames[index] + np.uint16(mask[index] & np.uint8(1)))
        # Numbers wrap.
        frames[index] = max(more, frames[index])


@compiled
def _choose(
    columns: Indices,
    image: ByteLine,
    marks: Marks,
    background: FloatLine,
    valid: ByteLine,
    known_frames: CountLine,
    other: ByteLine,
    other_frames: CountLine,
    limits: Limits,
) -> None:
    """Chooses between the two values of some pixels of a line; see `learn`."""
    mask, quiet, rounded, thresholds = marks
    quiet_frames, absorb_frames, same, min_frames = limits
    most = max(MAX_FRAMES, absorb_frames)
    for here in columns:
        is_provisional, is_quiet = bool(valid[here] == PROVISIONAL), bool(quiet[here] > 0)
        is_foreground = bool(mask[here] > 0)
        known, count = int(np.int64(known_frames[here])), int(np.int64(other_frames[here]))
        # Signed: differences of bytes wrap.
        value, ground = int(np.int64(image[here])), int(np.int64(rounded[here]))
        limit = same if is_provisional else int(np.int64(thresholds[here]))
        is_refused = False
        if valid[here] != UNKNOWN and not (is_provisional and abs(value - ground) <= limit):
            shows_other = abs(value - int(np.int64(other[here]))) <= limit
            if shows_other:
                count = min(count + int(is_provisional or is_quiet), most)
            elif count > 1:
                count -= 1
            else:
                # The other value has no frame left: this one takes its place.
                shows_other, count, other[here] = True, int(is_provisional), value
            if is_provisional:
                # What is quiet was there for quiet_frames.
                age = max(count, quiet_frames) if is_quiet else count
                wins = (shows_other or is_quiet) and age > known and age >= min_frames
            else:
                age = count
                wins = is_quiet and shows_other and age >= min(known, absorb_frames)
            if is_foreground and wins:
                background[here], other[here] = value, ground
                known, count = age, min(known, most)
            is_refused = is_foreground and not wins
        if is_foreground and is_quiet:
            mask[here] = STOPPED
        if is_quiet and valid[here] != KNOWN and not is_refused:
            background[here], valid[here] = value, KNOWN
            known = max(known, quiet_frames)
        known_frames[here], other_frames[here] = known, count
