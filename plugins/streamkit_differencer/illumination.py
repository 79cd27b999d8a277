"""Changes of brightness of the whole frame, such as exposure steps or automatic gain."""

from __future__ import annotations

import math

import numpy as np
from numba import types

from streamkit_differencer.arrays import ByteImage, FloatImage, FloatLine
from streamkit_kernels import FLOAT32_STRIDED, UINT8_STRIDED, kernel

SAMPLE_STEP = 8
SAMPLES = 600
MIN_SAMPLES = 100
ROUNDS = 4
GAIN_LIMITS = (0.4, 2.5)
DARKEST, BRIGHTEST = 8, 247
# Equation 3 follows smaller changes of most pixels.
MIN_SHIFT = 4.0
MIN_AGREEMENT = 0.6
NEAR = 10.0


def exposure_change(model: FloatImage, current: ByteImage, known: ByteImage) -> tuple[float, float] | None:
    """Estimates the change of brightness of the whole image, from some hundred pixels of a grid.

    A line is fitted to the pairs of values, then again to the inliers, without moving objects and ghosts.
    Pixels near black and white are left out: they may be clipped.

    Args:
        model: float32[h, w], the known image.
        current: uint8[h, w], the current image, 0 where it shows nothing.
        known: uint8[h, w], mask of the pixels where the model is known.

    Returns:
        Gain and offset, grey levels, from `model` to `current`; None if the change is too small, if there are
        too few pixels, or if it does not fit most of them.
    """
    step = max(SAMPLE_STEP, round(math.sqrt(current.size / SAMPLES)))
    before, after = sampled(model, current, known, step)
    if before.size < MIN_SAMPLES:
        return None
    shifts = after - before
    brighter, darker = np.count_nonzero(shifts >= MIN_SHIFT), np.count_nonzero(shifts <= -MIN_SHIFT)
    if 2 * max(brighter, darker) <= shifts.size:
        return None
    gain, offset = 1.0, float(np.median(shifts))
    for _ in range(ROUNDS):
        residual = np.abs(after - gain * before - offset)
        near = residual <= max(3.0 * float(np.median(residual)), 2.0)
        if before[near].var() < 1.0:
            break
        gain, offset = np.polyfit(before[near], after[near], 1).tolist()
    agreement = (np.abs(after - gain * before - offset) <= NEAR).mean()
    is_sound = GAIN_LIMITS[0] <= gain <= GAIN_LIMITS[1] and agreement >= MIN_AGREEMENT
    return (gain, offset) if is_sound else None


@kernel(FLOAT32_STRIDED, *[UINT8_STRIDED] * 2, types.int64)
def sampled(
    model: FloatImage, current: ByteImage, known: ByteImage, step: int
) -> tuple[FloatLine, FloatLine]:
    """The values of both images, float32[n] each, at the points of a grid where neither is clipped."""
    most = (len(current) // step + 1) * (current.shape[1] // step + 1)
    before, after, count = np.empty(most, np.float32), np.empty(most, np.float32), 0
    for row in range(step // 2, current.shape[0], step):
        for column in range(step // 2, current.shape[1], step):
            value, now = model[row, column], np.float32(current[row, column])
            if known[row, column] and min(value, now) > DARKEST and max(value, now) < BRIGHTEST:
                before[count], after[count] = value, now
                count += 1
    return before[:count].copy(), after[:count].copy()
