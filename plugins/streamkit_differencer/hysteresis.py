"""Foreground by thresholding with hysteresis, without lone pixels.

A registration tolerance hides the grey parts of an object. Pixels above the lower threshold that touch clear
foreground belong to it.

Source: Canny, "A Computational Approach to Edge Detection", PAMI 1986.
"""

from __future__ import annotations

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, Region
from streamkit_differencer.pixel_classes import BACKGROUND, WEAK

MEDIAN_PX = 3
GROWTH_STEPS = 2
GROWTH_SQUARE = np.ones((5, 5), np.uint8)  # two pixels in each direction


def strong_mask(levels: ByteImage, mask: ByteImage, region: Region) -> None:
    """The pixels above the upper threshold.

    Args:
        levels: uint8[h, w], see `pixel_classes.classify`.
        mask: uint8[h, w], output.
        region: of both.
    """
    top, bottom, left, right = region
    inside = np.s_[top:bottom, left:right]
    mask[inside] = _above(levels[inside], WEAK)


def hysteresis_mask(levels: ByteImage, mask: ByteImage, region: Region) -> None:
    """The foreground after a median, grown in two steps of two pixels through weak pixels.

    Args:
        levels: uint8[h, w], see `pixel_classes.classify`; background that the median fills becomes weak.
        mask: uint8[h, w], output.
        region: of both; its border is replicated.
    """
    top, bottom, left, right = region
    inside = np.s_[top:bottom, left:right]
    level = levels[inside]
    foreground = np.asarray(cv2.medianBlur(_above(level, WEAK), MEDIAN_PX), np.uint8)
    level[(foreground > 0) & (level == BACKGROUND)] = WEAK
    weak = _above(level, BACKGROUND)
    for _ in range(GROWTH_STEPS):
        foreground = weak & np.asarray(cv2.dilate(foreground, GROWTH_SQUARE), np.uint8)
    mask[inside] = foreground


def _above(levels: ByteImage, level: int) -> ByteImage:
    return np.asarray(cv2.threshold(levels, level, 255, cv2.THRESH_BINARY)[1], np.uint8)
