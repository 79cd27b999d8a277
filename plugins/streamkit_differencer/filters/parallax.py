"""Parallax of tall objects under a moving camera: they shift over the ground against the camera's motion.

A camera at height H that moves by c over the ground sees the top of an object of height h shift by
-c h / (H - h). What shows along its edges lay a little farther along the camera's path before: the object's
own edge on the side that covers ground, and similar ground next to it on the side that uncovers ground. A
vehicle differs from the background there, unless it comes towards the camera no faster than roofs shift: that
is the cost of the filter.
"""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import ByteImage, Flags, LabelImage
from streamkit_kernels import INT32, UINT8_STRIDED, compiled, kernel

# Smallest camera step with parallax, px.
MIN_STEP_PX = 2.0
# The background lags: it shows edges where they were some multiples of tau before; the earlier frame shows
# them where they were one tau before, with a margin in px.
LAG, EARLY_PX = 5.0, 0.5
# Share of a component that the shift must explain.
EXPLAINED = 0.8
# More blocks are sampled.
MAX_BLOCKS = 1000


@kernel(*[UINT8_STRIDED] * 7, INT32, types.int64, types.int64, types.float64, types.float64)
def find_parallax(
    image: ByteImage,
    background: ByteImage,
    valid: ByteImage,
    earlier: ByteImage,
    earlier_seen: ByteImage,
    thresholds: ByteImage,
    mask: ByteImage,
    blocks: LabelImage,
    count: int,
    radius: int,
    shift_x: float,
    shift_y: float,
) -> Flags:
    """The components of foreground that the shift explains, both by the background and by the earlier frame.

    The background alone may explain a vehicle that was learnt, the frame alone a slow one.

    Args:
        image: uint8[h, w], f(t), as all images.
        background: uint8[h, w], B(t - 1), rounded.
        valid: uint8[h, w], mask of where it is known.
        earlier: uint8[h, w], f(t - tau).
        earlier_seen: uint8[h, w], mask of what it covers.
        thresholds: uint8[h, w], T_F of each pixel, grey levels.
        mask: uint8[h, w], foreground.
        blocks: int32[n, 3], its components, see `components_of`.
        count: number of components.
        radius: registration error to tolerate, px.
        shift_x: vector to where tall objects may have shifted from: the motion of the view over the canvas in
            the last tau frames, times the largest h / (H - h); px.
        shift_y: the same, downwards.

    Returns:
        bool[count].
    """
    pixels, explained = np.zeros(count, np.int64), np.zeros(count, np.int64)
    beyond = 1.0 + EARLY_PX / np.sqrt(shift_x * shift_x + shift_y * shift_y)
    for index in range(0, len(blocks), max(1, -(-len(blocks) // MAX_BLOCKS))):
        row, column, component = blocks[index, 0], blocks[index, 1], blocks[index, 2]
        # The diagonal corner where this one is not in the mask; blocks with neither are skipped.
        other = int(mask[row, column] == 0)
        row, column = row + other, column + other
        if mask[row, column] == 0:
            continue
        pixels[component] += 1
        # Signed, as bounds may be below zero.
        value, most = np.int64(image[row, column]), np.int64(thresholds[row, column])
        low, high = value - most, value + most
        path = LAG * shift_x, LAG * shift_y
        if _explains(background, valid, 1, radius, row, column, path, low, high):
            path = beyond * shift_x, beyond * shift_y
            is_seen = _explains(earlier, earlier_seen, 0, 1, row, column, path, low, high)
            explained[component] += int(is_seen)
    shifted = np.zeros(count, np.bool_)
    for component in range(count):
        shifted[component] = explained[component] >= EXPLAINED * max(pixels[component], 1)
    return shifted


@compiled
def _explains(
    image: ByteImage,
    known: ByteImage,
    border: int,
    radius: int,
    row: int,
    column: int,
    path: tuple[float, float],
    low: np.int64,
    high: np.int64,
) -> bool:
    """Whether the range of values along a path, within the radius, overlaps `low` to `high`.

    Pixels nearer than `border` to unknown ones do not count: an object that enters the frame was there, too.
    """
    bottom, right = image.shape
    steps = int(np.rint(max(abs(path[0]), abs(path[1]))))
    lowest, highest = np.int64(255), np.int64(0)
    for step in range(steps + 1):
        part = step / max(steps, 1)
        y = min(max(row + int(np.rint(part * path[1])), 0), bottom - 1)
        x = min(max(column + int(np.rint(part * path[0])), 0), right - 1)
        if not _is_all_set(known, y, x, border):
            continue
        for y_near in range(max(y - radius, 0), min(y + radius + 1, bottom)):
            for x_near in range(max(x - radius, 0), min(x + radius + 1, right)):
                value = np.int64(image[y_near, x_near])
                lowest, highest = min(lowest, value), max(highest, value)
        if lowest <= high and highest >= low:
            return True
    return False


@compiled
def _is_all_set(mask: ByteImage, row: int, column: int, border: int) -> bool:
    """Whether all pixels within `border` of a pixel are not 0."""
    for y in range(max(row - border, 0), min(row + border + 1, mask.shape[0])):
        for x in range(max(column - border, 0), min(column + border + 1, mask.shape[1])):
            if mask[y, x] == 0:
                return False
    return True
