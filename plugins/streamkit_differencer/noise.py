"""Noise of each pixel of the background, the unit of equation 4's threshold.

A road is quiet, leaves are not, and an edge with a registration error flickers: one threshold for all pixels
is too high for the first or too low for the others.
"""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatImage
from streamkit_differencer.ground import PROVISIONAL, Ground

HIGHEST_THRESHOLD = 60
# Of a normal distribution: standard deviation over mean absolute deviation.
DEVIATION_RATIO = 1.2533
# First mean deviation of a pixel, and the share of the local range that is added: edges may flicker.
FIRST_DEVIATION, EDGE_SHARE = np.float32(1.5), np.float32(0.08)
# Noise changes slowly: it is learnt from one frame of so many.
NOISE_INTERVAL = 4
# Weight of such a frame in a pixel's noise, and in that of a pixel that was never quiet.
LEARNING_RATE, RESTLESS_RATE = 0.2, 0.4
# Where more of a frame is foreground, what passes for background may be part of what moves.
MAX_FOREGROUND = 0.3


def thresholds_of(deviation: FloatImage, gain: float, lowest: float) -> ByteImage:
    """T_F of each pixel, uint8[h, w]: so many standard deviations, but not below `lowest` grey levels."""
    limits = cv2.convertScaleAbs(deviation, alpha=gain * DEVIATION_RATIO)
    cv2.threshold(limits, HIGHEST_THRESHOLD, 0, cv2.THRESH_TRUNC, dst=limits)
    return cast("ByteImage", cv2.max(limits, np.full_like(limits, int(lowest)), dst=limits))


def learn_noise(ground: Ground, difference: ByteImage, mask: ByteImage, averaged: ByteImage) -> None:
    """Learns the mean absolute deviation of each pixel as a running mean.

    Args:
        ground: its deviation is updated in place.
        difference: uint8[h, w], of the frame to the background, as far as it counts.
        mask: uint8[h, w], foreground.
        averaged: uint8[h, w], mask of known background at rest.
    """
    cv2.accumulateWeighted(difference, ground.deviation, LEARNING_RATE, mask=averaged)
    if cv2.countNonZero(mask) < MAX_FOREGROUND * mask.size:
        restless = ((ground.valid == PROVISIONAL) & (mask == 0)).view(np.uint8)
        cv2.accumulateWeighted(difference, ground.deviation, RESTLESS_RATE, mask=restless)
