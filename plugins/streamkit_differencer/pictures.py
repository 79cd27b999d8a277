"""Foreground as pictures: at the frame's size, and in files."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]

# Marks from here on are things, below is shadow or ground.
LOWEST_THING = 100


def full_size(foreground: ByteImage | None, width: int, height: int) -> ByteImage:
    """The foreground at the frame's size, uint8[height, width]; black for a frame that was not judged.

    Args:
        foreground: uint8[h, w] at the working scale, or None.
        width: of the frame, px.
        height: of the frame, px.
    """
    if foreground is None:
        return np.zeros((height, width), np.uint8)
    scale = round(width / foreground.shape[1])
    if scale == 1 and foreground.shape == (height, width):
        return foreground.copy()
    size = foreground.shape[1] * scale, foreground.shape[0] * scale
    larger = cv2.resize(foreground, size, interpolation=cv2.INTER_NEAREST)
    # What halving cut off at the right and below belongs to the last row and column.
    rest = max(0, height - size[1]), max(0, width - size[0])
    grown = cv2.copyMakeBorder(larger, 0, rest[0], 0, rest[1], cv2.BORDER_REPLICATE)
    return cast("ByteImage", grown[:height, :width])


def only_things(mask: ByteImage) -> ByteImage:
    """A mask of 0 and 255 alone, as the tools of the change detection data sets read them."""
    return cast("ByteImage", cv2.threshold(mask, LOWEST_THING, 255, cv2.THRESH_BINARY)[1])
