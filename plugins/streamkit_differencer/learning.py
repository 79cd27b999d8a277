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

import numpy as np
from numba import types

from streamkit_differencer.arrays import (
    BOUNDS,
    Bounds,
    ByteImage,
    ByteLine,
    CountImage,
    CountLine,
    FloatImage,
    Indices,
)
from streamkit_differencer.equations import SET, update_background
from streamkit_differencer.ground import KNOWN, PROVISIONAL, UNKNOWN
from streamkit_differencer.noise import learn_noise
from streamkit_kernels import FLOAT32, UINT8, UINT16, compiled, kernel

# Frames are counted up to this, or up to `absorb_frames` if that is more.
MAX_FRAMES = 255
# Few pixels are undecided: a line is searched for them by so many columns at a time.
BLOCK = 64


@kernel(*[UINT8] * 4, FLOAT32, FLOAT32, UINT8, UINT16, BOUNDS, *[types.float64] * 3)
def learn_ground(
    image: ByteImage,
    mask: ByteImage,
    quiet: ByteImage,
    rounded: ByteImage,
    background: FloatImage,
    deviation: FloatImage,
    valid: ByteImage,
    known_frames: CountImage,
    bounds: Bounds,
    rate: float,
    noise_rate: float,
    restless_rate: float,
) -> None:
    """Equation 3 for known ground at rest, and the noise of ground.

    Args:
        image: uint8, f(t) on the canvas.
        mask: uint8[h, w], foreground, of the part of the canvas within the bounds.
        quiet: uint8[h, w], mask of D = 0, of the same part.
        rounded: uint8[h, w], B(t - 1) in whole grey levels, of the same part.
        background: float32, B; updated in place.
        deviation: float32, see `noise`; updated in place.
        valid: uint8, `UNKNOWN`, `PROVISIONAL` or `KNOWN`.
        known_frames: uint16, frames that the background was seen; updated in place.
        bounds: the part of the canvas that the frame covers.
        rate: alpha, weight of the frame in the background.
        noise_rate: weight of the frame in its noise; 0 for none.
        restless_rate: the same for ground that was never quiet.
    """
    top, bottom, left, right = bounds
    alpha, rates = np.float32(rate), (np.float32(noise_rate), np.float32(restless_rate))
    averaged = np.empty(right - left, np.uint8)
    for row in range(top, bottom):
        line, values, states = row - top, image[row, left:right], valid[row, left:right]
        _find_averaged(mask[line], quiet[line], states, averaged)
        update_background(background[row, left:right], values, averaged, alpha)
        _count(averaged, known_frames[row, left:right])
        if noise_rate > 0.0:
            images = values, rounded[line], averaged, mask[line], states
            learn_noise(*images, rates, deviation[row, left:right])


@compiled
def _find_averaged(mask: ByteLine, quiet: ByteLine, valid: ByteLine, averaged: ByteLine) -> None:
    """Known background at rest."""
    for index in range(averaged.size):
        is_known = (valid[index] == np.uint8(KNOWN)) & (mask[index] == np.uint8(0))
        averaged[index] = quiet[index] if is_known else np.uint8(0)


@compiled
def _count(mask: ByteLine, frames: CountLine) -> None:
    for index in range(mask.size):
        more = np.uint16(frames[index] + np.uint16(mask[index] & np.uint8(1)))
        # Numbers wrap.
        frames[index] = max(more, frames[index])


@kernel(*[UINT8] * 6, FLOAT32, UINT8, UINT16, UINT8, UINT16, BOUNDS, *[types.int64] * 4)
def choose_values(
    image: ByteImage,
    seen: ByteImage,
    mask: ByteImage,
    quiet: ByteImage,
    rounded: ByteImage,
    thresholds: ByteImage,
    background: FloatImage,
    valid: ByteImage,
    known_frames: CountImage,
    other: ByteImage,
    other_frames: CountImage,
    bounds: Bounds,
    quiet_frames: int,
    absorb_frames: int,
    same: int,
    min_frames: int,
) -> None:
    """Learns foreground and pixels that were never quiet.

    Args:
        image: see `learn_ground`, as what is not described here.
        seen: uint8, mask of what the frame covers on the canvas.
        mask: uint8[h, w].
        quiet: uint8[h, w].
        rounded: uint8[h, w].
        thresholds: uint8[h, w], T_F of each pixel: values that differ by no more are the same.
        background: float32; updated in place, as what follows.
        valid: uint8; quiet pixels become known.
        known_frames: uint16.
        other: uint8, the other value of each pixel.
        other_frames: uint16, frames that it was seen.
        bounds: the part of the canvas that the frame covers.
        quiet_frames: lambda, the frames that quiet pixels were seen at rest.
        absorb_frames: frames after which a stationary object becomes background at the latest.
        same: largest difference of values that are the same to a provisional background, grey levels.
        min_frames: frames in which the value that replaces such a background was seen.
    """
    top, bottom, left, right = bounds
    most, columns = max(MAX_FRAMES, absorb_frames), np.empty(right - left, np.int64)
    for row in range(top, bottom):
        line = row - top
        found = _find_undecided(mask[line], valid[row, left:right], seen[row, left:right], columns)
        for index in range(found):
            column = left + columns[index]
            part = line, columns[index]
            here = row, column
            is_provisional, is_quiet = bool(valid[here] == PROVISIONAL), bool(quiet[part] > 0)
            is_foreground = bool(mask[part] > 0)
            known, count = int(np.int64(known_frames[here])), int(np.int64(other_frames[here]))
            # Signed: differences of bytes wrap.
            value, ground = int(np.int64(image[here])), int(np.int64(rounded[part]))
            limit = int(np.int64(thresholds[part]))
            limit = min(limit, same) if is_provisional else limit
            is_refused = False
            if is_provisional and abs(value - ground) <= limit:
                known = min(known + 1, most)
            elif valid[here] != UNKNOWN:
                is_like = abs(value - int(np.int64(other[here]))) <= limit
                # A value that does not show loses a frame; without any left, another one takes its place.
                begins = not is_like and count <= 1
                if begins:
                    count, other[here] = int(is_provisional), value
                elif is_like:
                    count = min(count + int(is_provisional or is_quiet), most)
                else:
                    count -= 1
                # What is quiet was there for quiet_frames.
                age = max(count, quiet_frames) if is_provisional and is_quiet else count
                if is_provisional:
                    wins = (is_like or begins or is_quiet) and age > known and age >= min_frames
                else:
                    wins = is_quiet and (is_like or begins) and age >= min(known, absorb_frames)
                if is_foreground and wins:
                    background[here], other[here] = value, ground
                    known, count = age, min(known, most)
                is_refused = is_foreground and not wins
            if is_quiet and valid[here] != KNOWN and not is_refused:
                background[here], valid[here] = value, KNOWN
                known = max(known, quiet_frames)
            known_frames[here], other_frames[here] = known, count


@compiled
def _find_undecided(mask: ByteLine, valid: ByteLine, seen: ByteLine, columns: Indices) -> int:
    """The columns of a line with foreground, or with ground that was never quiet; returns their number."""
    count = 0
    for start in range(0, mask.size, BLOCK):
        stop = min(start + BLOCK, mask.size)
        if _has_undecided(mask[start:stop], valid[start:stop], seen[start:stop]):
            for column in range(start, stop):
                if (mask[column] | (valid[column] ^ SET)) & seen[column]:
                    columns[count] = column
                    count += 1
    return count


@compiled
def _has_undecided(mask: ByteLine, valid: ByteLine, seen: ByteLine) -> bool:
    united = np.uint8(0)
    for index in range(mask.size):
        united |= (mask[index] | (valid[index] ^ SET)) & seen[index]
    return bool(united > 0)
