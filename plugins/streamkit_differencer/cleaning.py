"""Cleaning of the foreground before objects are made of it: lone pixels out, holes filled."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

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
        uint8[h, w].
    """
    if median >= SMALLEST_MEDIAN - 1:
        mask = cast("ByteImage", cv2.medianBlur(mask, min(median | 1, LARGEST_MEDIAN)))
    if fill_holes:
        outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        whole = np.zeros_like(mask)
        cv2.drawContours(whole, outlines, -1, 255, cv2.FILLED)
        cv2.copyTo(mask, mask, whole)
        mask = whole
    return mask
