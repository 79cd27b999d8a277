"""Values of the foreground mask, and masks at the frame's size."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage

# Foreground that changed within quiet_frames, foreground that is quiet, and shadow; background is 0.
MOVING = 255
STOPPED = 128
SHADOW = 50
# Values up to this are background or shadow.
HIGHEST_BACKGROUND = 100


def full_size(mask: ByteImage | None, width: int, height: int) -> ByteImage:
    """The mask at the frame's size, uint8[height, width]; zeros for a frame without one.

    Args:
        mask: uint8[h, w] at the working scale, or None.
        width: of the frame, px.
        height: of the frame, px.
    """
    if mask is None:
        return np.zeros((height, width), np.uint8)
    scale = round(width / mask.shape[1])
    if scale == 1 and mask.shape == (height, width):
        return mask.copy()
    size = mask.shape[1] * scale, mask.shape[0] * scale
    larger = cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
    # Downsampling cut off a remainder at the right and bottom.
    rest = max(0, height - size[1]), max(0, width - size[0])
    if any(rest):
        larger = cv2.copyMakeBorder(larger, 0, rest[0], 0, rest[1], cv2.BORDER_REPLICATE)
    return cast("ByteImage", larger[:height, :width])


def binary_mask(mask: ByteImage) -> ByteImage:
    """uint8[h, w]: 255 for foreground, 0 for shadow and background."""
    return cast("ByteImage", cv2.threshold(mask, HIGHEST_BACKGROUND, 255, cv2.THRESH_BINARY)[1])
