"""Cleaning of the foreground before objects are made of it: lone pixels out, holes filled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from streamkit_differencer.resampling import padded, parts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]

SMALLEST_MEDIAN, LARGEST_MEDIAN = 3, 7


def cleaned(mask: ByteImage, median: int, fill_holes: bool) -> ByteImage:
    """The foreground without lone pixels, and without holes.

    Args:
        mask: uint8[h, w], values as they are marked; 0 is ground.
        median: width of the median filter, px; even ones are the next odd one, below 2 there is none.
        fill_holes: whether what is enclosed by foreground becomes foreground.

    Returns:
        uint8[h, w], an array of its own.
    """
    if median >= SMALLEST_MEDIAN - 1:
        width, cleaner = min(median | 1, LARGEST_MEDIAN), np.zeros_like(mask)
        for part in parts(mask):
            outer, inner = padded(part, width, mask.shape)
            cleaner[part] = cv2.medianBlur(np.ascontiguousarray(mask[outer]), width)[inner]
        mask = cleaner
    else:
        mask = mask.copy()
    if fill_holes:
        outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        whole = np.zeros_like(mask)
        cv2.drawContours(whole, outlines, -1, 255, cv2.FILLED)
        cv2.copyTo(mask, mask, whole)
        mask = whole
    return mask
