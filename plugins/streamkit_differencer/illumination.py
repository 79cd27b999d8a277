"""Changes of brightness of the whole frame, such as exposure steps or automatic gain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatImage

SAMPLE_STEP = 8
SAMPLES = 1500
FEWEST_SAMPLES = 100
ROUNDS = 4
GAIN_LIMITS = (0.4, 2.5)
DARKEST, BRIGHTEST = 8, 247
# Equation 3 follows smaller changes.
SMALLEST_SHIFT = 4.0
# Clipped pixels lower the median.
LEAST_SHIFT = 1.0
SMALLEST_AGREEMENT = 0.6
NEAR = 10.0


@dataclass(frozen=True, slots=True)
class BrightnessChange:
    """Linear change of brightness: gain times the value plus offset.

    Attributes:
        gain: factor.
        offset: grey levels.
    """

    gain: float
    offset: float


def exposure_change(
    model: FloatImage | ByteImage, current: ByteImage, *known: ByteImage
) -> BrightnessChange | None:
    """Estimates the change of brightness of the whole image, from some thousand pixels of a grid.

    A line is fitted to the pairs of values, then again to the inliers, without moving objects and ghosts.
    Pixels near black and white are left out: they may be clipped.

    Args:
        model: float32 or uint8[h, w], the known image.
        current: uint8[h, w], the current image.
        known: uint8[h, w] each, masks of the pixels where `model` is known; all must be set.

    Returns:
        The change from `model` to `current`; None if it is too small, if there are too few pixels,
        or if it does not fit most of them.
    """
    step = max(SAMPLE_STEP, round(math.sqrt(current.size / SAMPLES)))
    grid = np.s_[step // 2 :: step, step // 2 :: step]
    before, after = model[grid].astype(np.float32), current[grid].astype(np.float32)
    usable = known[0][grid] > 0
    for mask in known[1:]:
        usable &= mask[grid] > 0
    change = (after - before)[usable]
    # Most frames are as bright as the previous one.
    if change.size < FEWEST_SAMPLES or abs(np.median(change)) < LEAST_SHIFT:
        return None
    usable &= (np.minimum(before, after) > DARKEST) & (np.maximum(before, after) < BRIGHTEST)
    before, after = before[usable], after[usable]
    if before.size < FEWEST_SAMPLES:
        return None
    gain, offset = 1.0, float(np.median(after - before))
    if abs(offset) < SMALLEST_SHIFT:
        return None
    for _ in range(ROUNDS):
        residual = np.abs(after - gain * before - offset)
        near = residual <= max(3.0 * float(np.median(residual)), 2.0)
        spread = float(before[near].var())
        if spread < 1.0:
            break
        x, y = before[near] - before[near].mean(), after[near]
        gain = float(x @ y) / (spread * x.size)
        offset = float(y.mean() - gain * before[near].mean())
    if not GAIN_LIMITS[0] <= gain <= GAIN_LIMITS[1]:
        return None
    agreement = float((np.abs(after - gain * before - offset) <= NEAR).mean())
    return BrightnessChange(gain, offset) if agreement >= SMALLEST_AGREEMENT else None
