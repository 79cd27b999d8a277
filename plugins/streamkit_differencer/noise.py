"""Noise of each pixel of the background: what equation 4's threshold is measured in.

A road is quiet, leaves are not, and an edge that is registered a third of a pixel off flickers: one threshold
for all is too high for the first or too low for the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]

# Of a normal distribution: standard deviation over mean absolute deviation.
DEVIATION_RATIO = 1.2533
# A difference counts as at most so many standard deviations: a mover that was missed teaches little.
MOST_DEVIATIONS = 3.0


def thresholds(spread: FloatImage, gain: float, lowest: float, highest: float) -> ByteImage:
    """T_F of each pixel, uint8[h, w]: `gain` standard deviations, within bounds.

    Args:
        spread: float32[h, w], standard deviation of the background, grey levels.
        gain: standard deviations that are not foreground yet.
        lowest: smallest threshold, grey levels.
        highest: largest threshold, grey levels.
    """
    scaled = cv2.convertScaleAbs(spread, alpha=gain)
    return cast("ByteImage", np.clip(scaled, np.uint8(lowest), np.uint8(highest)))


def update_spread(
    spread: FloatImage, background: FloatImage, current: ByteImage, mask: ByteImage, coefficient: float
) -> None:
    """Learns the standard deviation of the pixels in `mask`, in place, as a running mean.

    Args:
        spread: float32[h, w], grey levels.
        background: float32[h, w], B(t - 1).
        current: uint8[h, w], f(t).
        mask: uint8[h, w], quiet pixels that show the background.
        coefficient: weight of this frame, 0 to 1.
    """
    deviation = cv2.absdiff(background, current.astype(np.float32))
    bounded = cv2.min(deviation * np.float32(DEVIATION_RATIO), spread * np.float32(MOST_DEVIATIONS))
    cv2.accumulateWeighted(bounded, spread, coefficient, mask=mask)
