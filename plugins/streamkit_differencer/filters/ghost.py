"""Ghosts: foreground where a thing was learnt as ground and has left."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]

_SQUARE = np.ones((3, 3), np.uint8)
_BORDER = np.ones((5, 5), np.uint8)
# So much of the outline must be so much stronger in the background than in the frame. A thing that is just
# leaving its ghost shows its own outline in front.
RATIO = 1.5
LEAST_EDGE = 8.0
AGREEMENT = 0.75


def ghost_mask(
    current: ByteImage, background: ByteImage, foreground: ByteImage, known: ByteImage
) -> ByteImage | None:
    """The pieces of foreground whose outline shows in the background and not in the frame.

    Args:
        current: uint8[h, w], f(t).
        background: uint8[h, w], B(t - 1), rounded.
        foreground: uint8[h, w], mask.
        known: uint8[h, w], mask of where the background is valid; outlines near the rest tell nothing.

    Returns:
        uint8[h, w], mask; a part of `foreground`. None where there are no ghosts.

    Source: the idea of Cucchiara, Grana, Piccardi and Prati, "Detecting Moving Objects, Ghosts, and Shadows
        in Video Streams", PAMI 2003, with edges for their optical flow.
    """
    left, top, width, height = cv2.boundingRect(foreground)
    if not width:
        return None
    # With a margin, or an outline at the edge of the area would be none.
    area = np.s_[max(0, top - 2) : top + height + 2, max(0, left - 2) : left + width + 2]
    count, labels = cv2.connectedComponents(foreground[area], connectivity=8)
    outline = cv2.bitwise_and(edges(foreground[area]), foreground[area])
    if not cv2.countNonZero(outline):
        return None
    columns, rows = cv2.findNonZero(outline).reshape(-1, 2).T
    owner = labels[rows, columns]
    here, there = (edges(image[area])[rows, columns].astype(np.int16) for image in (current, background))
    decided = cv2.erode(known[area], _BORDER)[rows, columns] > 0
    length = np.bincount(owner, minlength=count)
    sure = np.bincount(owner[decided], minlength=count)
    votes = np.bincount(owner[decided & (there > RATIO * here + LEAST_EDGE)], minlength=count)
    is_ghost = (votes >= AGREEMENT * np.maximum(sure, 1)) & (2 * sure >= length)
    is_ghost[0] = False
    if not is_ghost.any():
        return None
    result = np.zeros_like(foreground)
    result[area] = is_ghost[labels].astype(np.uint8) * np.uint8(255)
    return result


def edges(image: ByteImage) -> ByteImage:
    """The range of values around each pixel, uint8[h, w]."""
    return cast("ByteImage", cv2.morphologyEx(image, cv2.MORPH_GRADIENT, _SQUARE))
