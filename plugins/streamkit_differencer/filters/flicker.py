"""Pixels that turn from background to foreground and back again and again: leaves, water, lamps."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]

# A turn adds, each frame takes away: what turns more often than every eighth frame is found out.
TURN = 16
DECAY = 2
LIMIT = 80


def update_flicker(restless: ByteImage, before: ByteImage, foreground: ByteImage) -> ByteImage:
    """Counts turns, in place, and says which foreground is to be left out.

    A vehicle that passes turns a pixel twice, which is not enough.

    Args:
        restless: uint8[h, w], the count so far; becomes that with this frame.
        before: uint8[h, w], foreground of the frame before, as a mask.
        foreground: uint8[h, w], foreground of this frame, as a mask.

    Returns:
        uint8[h, w], mask of the foreground that flickers.

    Source: the blinking pixels of St-Charles, Bilodeau and Bergevin, "SuBSENSE", IEEE TIP 2015.
    """
    turned = cv2.bitwise_xor(before, foreground)
    step = cv2.threshold(turned, 0, TURN, cv2.THRESH_BINARY)[1]
    cv2.subtract(restless, np.full_like(restless, DECAY), dst=restless)
    cv2.add(restless, step, dst=restless)
    often = cv2.threshold(restless, LIMIT, 255, cv2.THRESH_BINARY)[1]
    return cast("ByteImage", cv2.bitwise_and(often, foreground))
