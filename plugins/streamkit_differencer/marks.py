"""What foreground is marked with, where the model tells more of it than that it is there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]

# Foreground that is quiet, and shadow; other foreground has 255.
FOREGROUND_QUIET = 128
SHADOW = 50


def marked(
    mask: ByteImage, quiet: ByteImage, shadow: ByteImage | None, parts: list[tuple[slice, slice]]
) -> ByteImage:
    """The foreground with what it is, in an array of its own.

    Args:
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of the pixels that did not change lately.
        shadow: uint8[h, w], mask of shadow; None where it is not told.
        parts: rectangles that hold all of the foreground.
    """
    marks = np.zeros_like(mask)
    for part in parts:
        still = cv2.bitwise_and(mask[part], quiet[part])
        cv2.threshold(still, 0, 255 - FOREGROUND_QUIET, cv2.THRESH_BINARY, dst=still)
        cv2.subtract(mask[part], still, dst=marks[part])
    if shadow is not None:
        cv2.copyTo(np.full_like(mask, SHADOW), shadow & mask, marks)
    return marks
