"""What foreground is marked with, where the model tells more of it than that it is there."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]

# Foreground that is quiet, and shadow; other foreground has 255.
FOREGROUND_QUIET = 128
SHADOW = 50


def marked(mask: ByteImage, still: ByteImage, shadow: ByteImage | None) -> ByteImage:
    """The foreground with what it is, in an array of its own; uses up `still`."""
    cv2.bitwise_and(mask, still, dst=still)
    cv2.threshold(still, 0, 255 - FOREGROUND_QUIET, cv2.THRESH_BINARY, dst=still)
    marks = cast("ByteImage", cv2.subtract(mask, still))
    if shadow is not None:
        cv2.copyTo(np.full_like(mask, SHADOW), shadow & mask, marks)
    return marks
