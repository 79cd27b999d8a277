"""Ghosts: foreground where a thing was learnt as ground and has left."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from streamkit_differencer.filters.pieces import Pieces, points_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    IntArray = NDArray[np.intp]

_SQUARE = np.ones((3, 3), np.uint8)
_BORDER = np.ones((5, 5), np.uint8)
# So much of the outline must be so much stronger in the background than in the frame. A thing that is just
# leaving its ghost shows its own outline in front.
RATIO = 1.5
LEAST_EDGE = 8.0
AGREEMENT = 0.75


def ghost_mask(
    current: ByteImage, background: ByteImage, pieces: Pieces, known: ByteImage
) -> ByteImage | None:
    """The pieces of foreground whose outline shows in the background and not in the frame.

    Args:
        current: uint8[h, w], f(t).
        background: uint8[h, w], B(t - 1), rounded.
        pieces: of the foreground.
        known: uint8[h, w], mask of where the background is valid; outlines near the rest tell nothing.

    Returns:
        uint8[h, w], mask; a part of the foreground. None where there are no ghosts.

    Source: the idea of Cucchiara, Grana, Piccardi and Prati, "Detecting Moving Objects, Ghosts, and Shadows
        in Video Streams", PAMI 2003, with edges for their optical flow.
    """
    foreground = pieces.mask
    outline = cv2.bitwise_and(edges(foreground), foreground)
    rows, columns = points_of(cast("ByteImage", outline))
    if not rows.size:
        return None
    owner, count = pieces.owners(rows, columns), pieces.count
    here, there = (range_at(image, rows, columns) for image in (current, background))
    decided = cv2.erode(known, _BORDER)[rows, columns] > 0
    length = np.bincount(owner, minlength=count)
    sure = np.bincount(owner[decided], minlength=count)
    votes = np.bincount(owner[decided & (there > RATIO * here + LEAST_EDGE)], minlength=count)
    is_ghost = (votes >= AGREEMENT * np.maximum(sure, 1)) & (2 * sure >= length)
    is_ghost[0] = False
    return pieces.only(is_ghost) if is_ghost.any() else None


def range_at(image: ByteImage, rows: IntArray, columns: IntArray) -> NDArray[np.int16]:
    """The range of values around some pixels, int16[n]."""
    offsets = np.indices((3, 3)).reshape(2, 9, 1) - 1
    height, width = image.shape
    values = image[np.clip(rows + offsets[0], 0, height - 1), np.clip(columns + offsets[1], 0, width - 1)]
    return np.asarray(values.max(axis=0).astype(np.int16) - values.min(axis=0), np.int16)


def edges(image: ByteImage) -> ByteImage:
    """The range of values around each pixel, uint8[h, w]."""
    return cast("ByteImage", cv2.morphologyEx(image, cv2.MORPH_GRADIENT, _SQUARE))
