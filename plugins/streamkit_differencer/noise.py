"""Noise of each pixel of the background: what equation 4's threshold is measured in.

A road is quiet, leaves are not, and an edge that is registered a third of a pixel off flickers: one threshold
for all is too high for the first or too low for the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from streamkit_differencer.scratch import Scratch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]

SAMPLE_STEP = 8
MOST_DEVIATIONS = 3.0
LEAST_FIRST = 1.5
HIGHEST_THRESHOLD = 60.0
# Of a normal distribution: standard deviation over mean absolute deviation.
DEVIATION_RATIO = 1.2533


def thresholds(
    spread: FloatImage,
    gain: float,
    lowest: float,
    highest: float = HIGHEST_THRESHOLD,
    *,
    out: ByteImage | None = None,
) -> ByteImage:
    """T_F of each pixel, uint8[h, w]: `gain` standard deviations, within bounds.

    Args:
        spread: float32[h, w], mean absolute deviation of the background, grey levels.
        gain: standard deviations that are not foreground yet.
        lowest: smallest threshold, grey levels.
        highest: largest threshold, grey levels; no less than the smallest.
        out: uint8[h, w], where the result goes; None for an array of its own.
    """
    needed = np.empty(spread.shape, np.uint8) if out is None else out
    cv2.convertScaleAbs(spread, dst=needed, alpha=gain * DEVIATION_RATIO)
    lowest = min(lowest, 255.0)
    return np.clip(needed, np.uint8(lowest), np.uint8(max(lowest, highest)), out=needed)


def first_spread(earlier: ByteImage, current: ByteImage) -> float:
    """What a pixel whose background is a single frame differs from it by: the mean difference of two frames.

    Every eighth pixel of every eighth row tells; movers lose their say.

    Args:
        earlier: uint8[h, w], a frame on the canvas.
        current: uint8[h, w], a later one.
    """
    grid = np.s_[SAMPLE_STEP // 2 :: SAMPLE_STEP, SAMPLE_STEP // 2 :: SAMPLE_STEP]
    difference = np.abs(earlier[grid].astype(np.float32) - current[grid])
    if not difference.size:
        return LEAST_FIRST
    usual = difference[difference <= MOST_DEVIATIONS * np.median(difference) + 1.0]
    return max(float(usual.mean()), LEAST_FIRST)


def update_spread(
    spread: FloatImage,
    background: ByteImage,
    current: ByteImage,
    mask: ByteImage,
    most: ByteImage,
    coefficient: float,
    scratch: Scratch | None = None,
) -> None:
    """Learns the mean absolute deviation of the pixels in `mask`, in place, as a running mean.

    Args:
        spread: float32[h, w], grey levels.
        background: uint8[h, w], B(t - 1), rounded.
        current: uint8[h, w], f(t).
        mask: uint8[h, w], quiet pixels that show the background.
        most: uint8[h, w], what a difference counts as at most: a mover that was missed teaches little.
        coefficient: weight of this frame, 0 to 1.
        scratch: planes to work in.
    """
    deviation = (scratch or Scratch()).plane("deviation", current.shape)
    cv2.absdiff(background, current, dst=deviation)
    cv2.min(deviation, most, dst=deviation)
    cv2.accumulateWeighted(deviation, spread, coefficient, mask=mask)
