"""Changes of brightness of the whole picture: exposure steps, automatic gain, a cloud's shadow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]

SAMPLE_STEP = 8
SAMPLES = 1500
FEWEST_SAMPLES = 100
ROUNDS = 4
GAIN_LIMITS = (0.4, 2.5)
DARKEST, BRIGHTEST = 8, 247
# Smaller steps than this are learnt by equation 3 in time.
SMALLEST_SHIFT = 4.0
# Pixels that are clipped pull the median down.
LEAST_SHIFT = 1.0
SMALLEST_AGREEMENT = 0.6
# Deviation of a picture that has something to be recognised by, and the correlation of two of another scene.
LEAST_TEXTURE = 8.0
LEAST_CORRELATION = 0.3
NEAR = 10.0


@dataclass(frozen=True, slots=True)
class Brightness:
    """The linear change that makes one picture as bright as another: gain times the value plus offset.

    Attributes:
        gain: factor.
        offset: grey levels.
    """

    gain: float
    offset: float


def is_another_scene(earlier: ByteImage, current: ByteImage, known: ByteImage, share: float) -> bool:
    """Whether two pictures of one place show different things: the camera was switched, covered or blinded.

    Means of 8 by 8 pixels tell, which noise leaves alone.

    Args:
        earlier: uint8[h, w].
        current: uint8[h, w].
        known: uint8[h, w], mask of the pixels that both show.
        share: of means that must have changed where the pictures are still alike.

    Returns:
        Whether that share has changed, or the pictures are not alike at all.
    """
    size = max(1, current.shape[1] // SAMPLE_STEP), max(1, current.shape[0] // SAMPLE_STEP)
    means = [cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in (earlier, current, known)]
    usable = means[2] == 255
    before, after = means[0][usable].astype(np.float32), means[1][usable].astype(np.float32)
    if not before.size:
        return False
    if np.mean(np.abs(after - before) > NEAR) > share:
        return True
    if before.size < FEWEST_SAMPLES or min(before.std(), after.std()) < LEAST_TEXTURE:
        return False
    return bool(np.corrcoef(before, after)[0, 1] < LEAST_CORRELATION)


def exposure_step(model: FloatImage | ByteImage, current: ByteImage, *known: ByteImage) -> Brightness | None:
    """Estimates how the brightness of the whole picture changed, from some thousand pixels of a grid.

    A line is fitted to the pairs of values, then again to the pairs close to it, so that movers and ghosts
    lose their say. Pixels near black and white are left out: they may be clipped.

    Args:
        model: float32 or uint8[h, w], the picture as it is known.
        current: uint8[h, w], the picture as it is now.
        known: uint8[h, w] each, masks of the pixels where `model` holds; all must be set.

    Returns:
        The change from `model` to `current`; None if it is too small to follow, if too few pixels tell, or if
        it does not explain the picture and is therefore no change of exposure.
    """
    step = max(SAMPLE_STEP, round(math.sqrt(current.size / SAMPLES)))
    grid = np.s_[step // 2 :: step, step // 2 :: step]
    before, after = model[grid].astype(np.float32), current[grid].astype(np.float32)
    usable = known[0][grid] > 0
    for mask in known[1:]:
        usable &= mask[grid] > 0
    change = (after - before)[usable]
    # Most frames are as bright as the one before, and are done with here.
    if change.size < FEWEST_SAMPLES or abs(median(change)) < LEAST_SHIFT:
        return None
    usable &= (np.minimum(before, after) > DARKEST) & (np.maximum(before, after) < BRIGHTEST)
    before, after = before[usable], after[usable]
    if before.size < FEWEST_SAMPLES:
        return None
    gain, offset = 1.0, median(after - before)
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
    return Brightness(gain, offset) if agreement >= SMALLEST_AGREEMENT else None


def median(values: NDArray[np.float32]) -> float:
    """The upper median; numpy's own takes four times as long on a thousand values."""
    middle = values.size // 2
    return float(np.partition(values, middle)[middle])
