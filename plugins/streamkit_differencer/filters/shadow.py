"""Cast shadows: darker than the background by one factor, with its texture preserved."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage

WINDOW_PX = 5
DARKEST, BRIGHTEST = 0.4, 0.93
# Largest standard deviation of the ratio within a window of shadow, beyond noise.
MAX_DEVIATION = 0.04
NOISE_LEVELS = 3.0
# A component with more shadow is a dark vehicle on plain ground.
MAX_SHARE = 0.7


def shadow_mask(current: ByteImage, background: ByteImage, foreground: ByteImage) -> ByteImage:
    """The foreground that is shadow.

    The ratio of frame to background is constant within a shadow and varies on an object. A component that
    would lose more than `MAX_SHARE` counts as a dark object and stays whole.

    Args:
        current: uint8[h, w], f(t).
        background: uint8[h, w], B(t - 1), rounded.
        foreground: uint8[h, w], mask.

    Returns:
        uint8[h, w], mask, a subset of `foreground`.

    Source: the ratio test of Rosin and Ellis, "Image difference threshold strategies and shadow detection",
        BMVC 1995, with the variance in a window instead of region growing.
    """
    left, top, width, height = cv2.boundingRect(foreground)
    result = np.zeros_like(foreground)
    if not width:
        return result
    area = np.s_[top : top + height, left : left + width]
    ground = np.maximum(background[area].astype(np.float32), 1.0)
    ratio = current[area].astype(np.float32) / ground
    size = (WINDOW_PX, WINDOW_PX)
    inside = cv2.threshold(foreground[area], 0, 1.0, cv2.THRESH_BINARY)[1].astype(np.float32)
    # Only foreground counts: the ratio jumps at the edge of a shadow.
    count = np.maximum(cv2.boxFilter(inside, -1, size, normalize=False), 1.0)
    mean = cv2.boxFilter(ratio * inside, -1, size, normalize=False) / count
    square = cv2.boxFilter(ratio * ratio * inside, -1, size, normalize=False) / count
    allowed = MAX_DEVIATION**2 + np.square(NOISE_LEVELS / ground)
    even = square - mean * mean <= allowed
    dark = (mean > DARKEST) & (mean < BRIGHTEST)
    candidate = np.where(even & dark & (inside > 0), np.uint8(255), np.uint8(0))
    result[area] = without_dark_objects(candidate, foreground[area])
    return result


def without_dark_objects(candidate: ByteImage, foreground: ByteImage) -> ByteImage:
    """The candidates without those that make up most of a component of foreground."""
    whole = cv2.threshold(foreground, 0, 255, cv2.THRESH_BINARY)[1]
    count, labels = cv2.connectedComponents(whole, connectivity=8)
    pixels = np.bincount(labels.ravel(), minlength=count)
    dark = np.bincount(labels[candidate > 0], minlength=count)
    kept = (dark <= MAX_SHARE * pixels) & (np.arange(count) > 0)
    return cast("ByteImage", candidate * kept[labels].astype(np.uint8))
