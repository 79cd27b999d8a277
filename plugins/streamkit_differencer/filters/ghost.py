"""Ghosts: foreground where a thing was learnt as ground and has left."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from streamkit_differencer.filters.pieces import Pieces, thinned
from streamkit_differencer.resampling import held, padded

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    BoolArray = NDArray[np.bool_]
    IntArray = NDArray[np.intp]

_SQUARE = np.ones((3, 3), np.uint8)
_AROUND = np.indices((3, 3)).reshape(2, 9, 1) - 1
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
    rows, columns, decided = outline_of(pieces, known)
    if not rows.size:
        return None
    owner, count = pieces.owners(rows, columns), pieces.count
    here, there = (range_at(image, rows, columns) for image in (current, background))
    length = np.bincount(owner, minlength=count)
    sure = np.bincount(owner[decided], minlength=count)
    votes = np.bincount(owner[decided & (there > RATIO * here + LEAST_EDGE)], minlength=count)
    is_ghost = (votes >= AGREEMENT * np.maximum(sure, 1)) & (2 * sure >= length)
    is_ghost[0] = False
    return pieces.only(is_ghost) if is_ghost.any() else None


def outline_of(pieces: Pieces, known: ByteImage) -> tuple[IntArray, IntArray, BoolArray]:
    """Rows and columns of the pixels at the edges of the pieces; whether all around each is known."""
    found = []
    for part in pieces.parts:
        outer, inner = padded(part, len(_BORDER) // 2, pieces.mask.shape)
        mask = pieces.mask[outer]
        outline = cv2.bitwise_and(edges(mask), mask)[inner]
        rows, columns = np.nonzero(outline != 0)
        decided = cv2.erode(known[outer], _BORDER)[inner][rows, columns] > 0
        found.append((rows + part[0].start, columns + part[1].start, decided))
    if not found:
        return np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0, bool)
    rows, columns, decided = (np.concatenate(values) for values in zip(*found, strict=True))
    few = thinned(len(rows))
    return rows[few], columns[few], decided[few]


def range_at(image: ByteImage, rows: IntArray, columns: IntArray) -> NDArray[np.int16]:
    """The range of values around some pixels, int16[n]."""
    height, width = image.shape
    values = image[held(rows + _AROUND[0], height), held(columns + _AROUND[1], width)]
    return np.asarray(values.max(axis=0).astype(np.int16) - values.min(axis=0), np.int16)


def edges(image: ByteImage) -> ByteImage:
    """The range of values around each pixel, uint8[h, w]."""
    return cast("ByteImage", cv2.morphologyEx(image, cv2.MORPH_GRADIENT, _SQUARE))
