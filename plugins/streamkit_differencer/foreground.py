"""The foreground of a frame: equation 4, and hysteresis where it tolerates a registration error.

A tolerance hides the grey parts of an object. Pixels above the lower threshold that touch clear foreground
belong to it.

Source: Canny, "A Computational Approach to Edge Detection", PAMI 1986.
"""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage
from streamkit_differencer.equations import excess_over_range, foreground_mask

# Smallest lower threshold, grey levels.
LEAST_WEAK = 5
MEDIAN_PX = 3
GROWTH_STEPS = 2
GROWTH_SQUARE = np.ones((5, 5), np.uint8)  # two pixels in each direction


def find_foreground(
    image: ByteImage,
    background: ByteImage,
    thresholds: ByteImage,
    known: ByteImage,
    tolerance: int,
    hysteresis_ratio: float,
) -> ByteImage:
    """Foreground by equation 4; with a tolerance after a median, and grown through weak pixels.

    Args:
        image: uint8[h, w], f(t).
        background: uint8[h, w], B(t - 1), rounded.
        thresholds: uint8[h, w], T_F of each pixel.
        known: uint8[h, w], mask of the pixels that the frame covers and whose background is known.
        tolerance: registration error to tolerate, px.
        hysteresis_ratio: lower threshold over the upper one; 1 is off.

    Returns:
        uint8[h, w], mask.
    """
    strong = foreground_mask(excess_over_range(image, background, tolerance), thresholds) & known
    if tolerance <= 0 or hysteresis_ratio >= 1.0:
        return strong
    difference = cv2.threshold(cv2.absdiff(image, background), LEAST_WEAK, 0, cv2.THRESH_TOZERO)[1]
    lower = cast("ByteImage", cv2.convertScaleAbs(thresholds, alpha=hysteresis_ratio))
    mask = cast("ByteImage", cv2.medianBlur(strong, MEDIAN_PX))
    weak = (foreground_mask(cast("ByteImage", difference), lower) | mask) & known
    for _ in range(GROWTH_STEPS):
        mask = weak & cast("ByteImage", cv2.dilate(mask, GROWTH_SQUARE))
    return mask
