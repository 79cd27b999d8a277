"""Learning from a frame: equation 3, stationary objects and new pixels."""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import REGION, ByteImage, ByteLine, FloatImage, FloatLine, Region
from streamkit_kernels import BYTES, FLOATS, compiled, kernel

# Update of a pixel's background: none, by equation 3, replaced by the frame, or its first one.
NONE, AVERAGED, REPLACED, NEW = 0, 1, 2, 3


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
