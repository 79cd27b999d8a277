"""Equations 1 to 4 of the paper, on the part of the canvas that a frame covers.

Three points differ from the print. Equation 1 leaves out the case of a pixel that stays quiet: its counter
stays 0. Equation 3 is meant for quiet pixels only. Equation 4 is printed with its cases swapped and with the
background of the wrong time: foreground is what differs from the background as it was before this frame.

Masks are uint8, 255 where set. Brightness is uint8, the background float32: in 8 bits a difference of less
than half a level per update would never be learnt.

Source: Zhang, Liu, Qu, "Research on Feature Extraction Method of UAV Video Image Based on Target Tracking",
section 2.2; the method is that of Collins et al., "A System for Video Surveillance and Monitoring", 2000.
"""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatImage

# Largest lambda. The counter D is kept as D + LONGEST_WAIT - lambda: a change sets it to this.
LONGEST_WAIT = 255


def changed_mask(
    image: ByteImage, earlier: ByteImage, threshold: float, ranges: ByteImage, gradient_gain: float
) -> ByteImage:
    """Equation 2: the pixels that differ from f(t - tau) by more than T_s.

    Args:
        image: uint8[h, w], f(t).
        earlier: uint8[h, w], f(t - tau).
        threshold: T_s, grey levels; a change exceeds it.
        ranges: uint8[h, w], the local range of `earlier`.
        gradient_gain: share of the local range that is added to the threshold, so that a registration error
            at an edge is no change; 0 gives the paper's equation.

    Returns:
        uint8[h, w], mask.
    """
    difference = cv2.absdiff(image, earlier)
    if gradient_gain > 0.0:
        cv2.addWeighted(difference, 1.0, ranges, -gradient_gain, 0.0, dst=difference)
    return cast("ByteImage", cv2.threshold(difference, threshold, 255, cv2.THRESH_BINARY, dst=difference)[1])


def count_down(waiting: ByteImage, changed: ByteImage) -> None:
    """Equation 1, in place: D = lambda where a pixel changed, else one less than before.

    Args:
        waiting: uint8[h, w], D(t - 1) + `LONGEST_WAIT` - lambda.
        changed: uint8[h, w], mask of what changed, S(t).
    """
    cv2.subtract(waiting, np.ones_like(waiting), dst=waiting)
    cv2.bitwise_or(waiting, changed, dst=waiting)


def quiet_mask(waiting: ByteImage, quiet_frames: int) -> ByteImage:
    """The pixels with D = 0 for this lambda, uint8[h, w]."""
    least = LONGEST_WAIT - quiet_frames
    return cast("ByteImage", cv2.threshold(waiting, least, 255, cv2.THRESH_BINARY_INV)[1])


def update_background(background: FloatImage, image: ByteImage, mask: ByteImage, rate: float) -> None:
    """Equation 3, in place: B(t) = alpha f(t) + (1 - alpha) B(t - 1) where `mask` is set."""
    cv2.accumulateWeighted(image, background, rate, mask=mask)


def foreground_mask(excess: ByteImage, thresholds: ByteImage) -> ByteImage:
    """Equation 4: the pixels that differ from B(t - 1) by more than their T_F, uint8[h, w]."""
    return cast("ByteImage", cv2.compare(excess, thresholds, cv2.CMP_GT))


def excess_over_range(image: ByteImage, background: ByteImage, tolerance: int) -> ByteImage:
    """Distance of each pixel from the range of the background within `tolerance` px, uint8[h, w]."""
    if tolerance <= 0:
        return cast("ByteImage", cv2.absdiff(image, background))
    square = np.ones((2 * tolerance + 1, 2 * tolerance + 1), np.uint8)
    above, below = cv2.dilate(background, square), cv2.erode(background, square)
    cv2.subtract(image, above, dst=above)
    cv2.subtract(below, image, dst=below)
    return cast("ByteImage", cv2.max(above, below, dst=above))
