"""Flicker: pixels that alternate between background and foreground, such as leaves, water, lamps."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage

# Each transition adds, each frame subtracts: more than one transition in eight frames is flicker.
TRANSITION, DECAY, LIMIT = 16, 2, 80


def update_flicker(count: ByteImage, before: ByteImage, foreground: ByteImage) -> ByteImage:
    """Counts transitions, in place; a vehicle that passes causes two, which is not enough.

    Args:
        count: uint8[h, w], updated in place.
        before: uint8[h, w], mask of the previous frame's foreground; updated in place.
        foreground: uint8[h, w], mask of this frame's foreground.

    Returns:
        uint8[h, w], mask of the foreground that flickers.

    Source: the blinking pixels of St-Charles, Bilodeau and Bergevin, "SuBSENSE", IEEE TIP 2015.
    """
    changed = before ^ foreground
    cv2.subtract(count, np.full_like(count, DECAY), dst=count)
    cv2.add(count, changed & np.uint8(TRANSITION), dst=count)
    before[:] = foreground
    return cast("ByteImage", np.where(count > LIMIT, foreground, np.uint8(0)))
