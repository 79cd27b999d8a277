"""Median filter and hole filling of the foreground."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage
from streamkit_differencer.mask_values import MOVING, SHADOW, STOPPED

SMALLEST_MEDIAN, LARGEST_MEDIAN = 3, 7


def cleaned(mask: ByteImage, median: int, fill_holes: bool) -> ByteImage:
    """The foreground after a median filter, with holes filled.

    Args:
        mask: uint8[h, w], see `mask_values`.
        median: width of the median filter, px; raised to an odd number; none below 2.
        fill_holes: whether pixels enclosed by foreground become foreground.

    Returns:
        uint8[h, w], a new array.
    """
    result = _median(mask, min(median | 1, LARGEST_MEDIAN))
    if fill_holes:
        outlines, _ = cv2.findContours(result, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        whole = np.zeros_like(result)
        cv2.drawContours(whole, outlines, -1, MOVING, cv2.FILLED)
        cv2.copyTo(result, result, whole)
        result = whole
    return result


def _median(mask: ByteImage, width: int) -> ByteImage:
    """`cv2.medianBlur` of a mask; for 7 px in a tenth of its time, by counting the pixels of each value."""
    if width < SMALLEST_MEDIAN:
        return mask.copy()
    if width < LARGEST_MEDIAN:
        return cast("ByteImage", cv2.medianBlur(mask, width))
    size, border, half = (width, width), cv2.BORDER_REPLICATE, width * width // 2
    result = np.zeros_like(mask)
    for value in (SHADOW, STOPPED, MOVING):
        votes = cv2.threshold(mask, value - 1, 1, cv2.THRESH_BINARY)[1]
        cv2.boxFilter(votes, -1, size, dst=votes, normalize=False, borderType=border)
        cv2.max(result, cv2.threshold(votes, half, value, cv2.THRESH_BINARY)[1], dst=result)
    return result
