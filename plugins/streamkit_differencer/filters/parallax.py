"""Tall things under a moving camera: they slide over the ground against the camera's own motion.

A camera at height H that moves by c over the ground sees the top of a thing of height h slide by
-c h / (H - h). What shows along its edges was a little farther along the camera's way before: the thing's own
edge on the side that covers ground, and ground like that beside it on the side that uncovers ground. A
vehicle does not look like what the background shows there, unless it comes towards the camera no faster than
roofs slide: that is what the filter costs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from streamkit_differencer.filters.pieces import Pieces
from streamkit_differencer.resampling import held, padded

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.intp]
    Region = tuple[slice, slice]

# A camera that moved less than this between the two frames shows no parallax, px.
SMALLEST_STEP_PX = 2.0
# Edges are noticed late: the background shows where they were so many times tau before, the earlier frame
# where they were one tau before, px beyond the slide itself.
LAG, EARLY_PX = 5.0, 0.5
# Of a piece of foreground, so much must be explained by what slides.
EXPLAINED = 0.8
_SQUARE = np.ones((3, 3), np.uint8)


def slide(camera_step: FloatArray, height_share: float) -> FloatArray | None:
    """How far, and from where, things may have slid: float64[2], px; None if none slides.

    Args:
        camera_step: float64[2], how far the camera's view moved over the canvas in the last tau frames, px.
        height_share: largest h / (H - h) looked for.
    """
    distance = float(np.linalg.norm(camera_step))
    if distance < SMALLEST_STEP_PX or height_share <= 0.0:
        return None
    return np.asarray(camera_step * height_share)


def reach(way: FloatArray) -> int:
    """How far from a pixel it is looked at, px."""
    farthest = np.abs(way).max() * max(LAG, 1.0 + EARLY_PX / float(np.linalg.norm(way)))
    return int(farthest) + 1


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """What a picture may have at each pixel where it is placed a pixel wrong.

    Attributes:
        lowest: uint8[h, w], smallest value within 1 px.
        highest: uint8[h, w], largest value.
        known: uint8[h, w], mask of where both hold.
    """

    lowest: ByteImage
    highest: ByteImage
    known: ByteImage


def known_around(known: ByteImage, plane: ByteImage, parts: list[Region], margin: int) -> ByteImage:
    """Where the bounds of a picture hold: it is known there and next to it.

    Args:
        known: uint8[h, w], mask.
        plane: uint8[h, w], becomes the mask.
        parts: where it is asked for; elsewhere `plane` keeps what it has.
        margin: how far around the parts it is asked for, px.
    """
    for part in parts:
        asked, _ = padded(part, margin, plane.shape)
        outer, inner = padded(asked, 1, plane.shape)
        plane[asked] = cv2.erode(known[outer], _SQUARE)[inner]
    return plane


def sliding_mask(
    current: ByteImage,
    ground: Bounds,
    earlier: Bounds,
    pieces: Pieces,
    threshold: float | ByteImage,
    way: FloatArray,
) -> ByteImage | None:
    """The pieces of foreground that only slid: both the background and the frame of tau before explain them.

    What is explained by the background alone may be a vehicle that was learnt, by the frame alone a slow one.

    Args:
        current: uint8[h, w], f(t).
        ground: of the background.
        earlier: of the frame of tau before.
        pieces: of the foreground.
        threshold: T_F of all or of each pixel, grey levels.
        way: float64[2], px, from where things are to where they may have come from, see `slide`.

    Returns:
        uint8[h, w], mask; a part of the foreground. None where nothing slides.
    """
    rows, columns, owner = pieces.points()
    if not rows.size:
        return None
    values = current[rows, columns]
    needed = threshold[rows, columns] if isinstance(threshold, np.ndarray) else threshold
    length = float(np.linalg.norm(way))
    explained = np.ones(rows.size, bool)
    for bounds, line in ((ground, way * LAG), (earlier, way * (1.0 + EARLY_PX / length))):
        lowest, highest = along(bounds, rows, columns, line)
        excess = np.maximum(values - np.minimum(values, highest), np.maximum(values, lowest) - values)
        explained &= excess <= needed
    pixels = np.bincount(owner, minlength=pieces.count)
    slides = np.bincount(owner[explained], minlength=pieces.count) >= EXPLAINED * np.maximum(pixels, 1)
    slides[0] = False
    return pieces.only(slides) if slides.any() else None


def along(bounds: Bounds, rows: IntArray, columns: IntArray, way: FloatArray) -> tuple[ByteImage, ByteImage]:
    """Smallest and largest value of a picture along a way from each pixel, uint8[n] each."""
    count = round(float(np.abs(way).max()))
    steps = np.rint(np.arange(count + 1)[:, None] / max(count, 1) * way).astype(np.intp)
    height, width = bounds.known.shape
    down, across = held(rows + steps[:, 1:], height), held(columns + steps[:, :1], width)
    # What is not known explains nothing: a mover that comes into view was there, too.
    usable = bounds.known[down, across]
    lowest = np.maximum(bounds.lowest[down, across], ~usable).min(axis=0)
    highest = np.minimum(bounds.highest[down, across], usable).max(axis=0)
    return lowest, highest
