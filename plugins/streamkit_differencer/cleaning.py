"""Median filter and hole filling of the foreground."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage
from streamkit_differencer.mask_values import MOVING

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
    if median >= SMALLEST_MEDIAN - 1:
        result = cast("ByteImage", cv2.medianBlur(mask, min(median | 1, LARGEST_MEDIAN)))
    else:
        result = mask.copy()
    if fill_holes:
        outlines, _ = cv2.findContours(result, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        whole = np.zeros_like(result)
        cv2.drawContours(whole, outlines, -1, MOVING, cv2.FILLED)
        cv2.copyTo(result, result, whole)
        result = whole
    return result
