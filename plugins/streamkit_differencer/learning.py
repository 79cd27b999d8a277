"""The choice between two values of a pixel: its background, and the other one that it shows.

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
    FLOAT32_OUTPUT,
    INT64_1D,
    UINT8_OUTPUT,
    UINT16_OUTPUT,
    ByteImage,
    CountImage,
    FloatImage,
    Indices,
)
from streamkit_differencer.ground import KNOWN, PROVISIONAL, UNKNOWN
from streamkit_kernels import UINT8, UINT8_STRIDED, kernel

# Frames are counted up to this, or up to `absorb_frames` if that is more.
MAX_FRAMES = 255
STATES = FLOAT32_OUTPUT, UINT8_OUTPUT, UINT16_OUTPUT, UINT8_OUTPUT, UINT16_OUTPUT


@kernel(INT64_1D, UINT8_STRIDED, *[UINT8] * 4, *STATES, *[types.int64] * 4)
def choose_values(
    undecided: Indices,
    image: ByteImage,
    mask: ByteImage,
    quiet: ByteImage,
    rounded: ByteImage,
    thresholds: ByteImage,
    background: FloatImage,
    valid: ByteImage,
    known_frames: CountImage,
    other: ByteImage,
    other_frames: CountImage,
    quiet_frames: int,
    absorb_frames: int,
    same: int,
    min_frames: int,
) -> None:
    """Learns from foreground and from pixels that were never quiet; the rest follows equation 3.

    Args:
        undecided: int64[n], those pixels, numbered row by row, in ascending order.
        image: uint8[h, w], f(t), as all images.
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of D = 0.
        rounded: uint8[h, w], B(t - 1) in whole grey levels.
        thresholds: uint8[h, w], T_F of each pixel: values that differ by no more are the same.
        background: float32[h, w], B; updated in place as the other states.
        valid: uint8[h, w], `UNKNOWN`, `PROVISIONAL` or `KNOWN`; quiet pixels become known.
        known_frames: uint16[h, w], frames that the background was seen.
        other: uint8[h, w], the other value of each pixel.
        other_frames: uint16[h, w], frames that it was seen.
        quiet_frames: lambda, the frames that quiet pixels were seen at rest.
        absorb_frames: frames after which a stationary object becomes background at the latest.
        same: largest difference of values that are the same to a provisional background, grey levels.
        min_frames: frames in which the value that replaces a provisional background was seen.
    """
    most = max(MAX_FRAMES, absorb_frames)
    row, row_start, width = 0, 0, image.shape[1]
    for pixel in undecided:
        # A division for each pixel takes as long as all else.
        while pixel >= row_start + width:
            row, row_start = row + 1, row_start + width
        column = pixel - row_start
        is_provisional = bool(valid[row, column] == PROVISIONAL)
        is_quiet = bool(quiet[row, column] > 0)
        is_foreground = bool(mask[row, column] > 0)
        known = int(np.int64(known_frames[row, column]))
        count = int(np.int64(other_frames[row, column]))
        # Signed: differences of bytes wrap.
        value, here = int(np.int64(image[row, column])), int(np.int64(rounded[row, column]))
        limit = int(np.int64(thresholds[row, column]))
        limit = min(limit, same) if is_provisional else limit
        is_refused = False
        if is_provisional and abs(value - here) <= limit:
            known, count = min(known + 1, most), max(count - 1, 0)
        elif valid[row, column] != UNKNOWN:
            is_like = abs(value - int(np.int64(other[row, column]))) <= limit
            # A value that does not show loses a frame; without any left, another one takes its place.
            begins = not is_like and count <= 1
            if begins:
                count, other[row, column] = int(is_provisional), value
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
                background[row, column], other[row, column] = value, here
                known, count = age, min(known, most)
            is_refused = is_foreground and not wins
        if is_quiet and valid[row, column] != KNOWN and not is_refused:
            background[row, column], valid[row, column] = value, KNOWN
            known = max(known, quiet_frames)
        known_frames[row, column], other_frames[row, column] = known, count
