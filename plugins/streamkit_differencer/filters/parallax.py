"""Tall things under a moving camera: they slide over the ground against the camera's own motion.

A camera at height H that moves by c over the ground sees the top of a thing of height h slide by
-c h / (H - h). What shows along its edges was a little farther along the camera's way before: the thing's own
edge on the side that covers ground, and ground like that beside it on the side that uncovers ground. A
vehicle does not look like what the background shows there, unless it comes towards the camera no faster than
roofs slide: that is what the filter costs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import types

from streamkit_differencer.canvas_region import REGION
from streamkit_differencer.filters.pieces import MOST_POINTS
from streamkit_kernels import BLOCKS, BYTES, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    FloatArray = NDArray[np.float64]
    Flags = NDArray[np.bool_]
    Blocks = NDArray[np.int32]

# A camera that moved less than this between the two frames shows no parallax, px.
SMALLEST_STEP_PX = 2.0
# Edges are noticed late: the background shows where they were so many times tau before, the earlier frame
# where they were one tau before, px beyond the slide itself.
LAG, EARLY_PX = 5.0, 0.5
# Of a piece of foreground, so much must be explained by what slides.
EXPLAINED = 0.8


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


@kernel(
    BYTES,
    BYTES,
    BYTES,
    BYTES,
    BYTES,
    BYTES,
    BYTES,
    BLOCKS,
    types.int64,
    REGION,
    types.int64,
    types.float64,
    types.float64,
)
def find_slides(
    image: ByteImage,
    background: ByteImage,
    valid: ByteImage,
    earlier: ByteImage,
    earlier_seen: ByteImage,
    needed: ByteImage,
    mask: ByteImage,
    blocks: Blocks,
    count: int,
    region: Region,
    radius: int,
    way_x: float,
    way_y: float,
) -> Flags:
    """The pieces of foreground that only slid: both the background and the frame of tau before explain them.

    What is explained by the background alone may be a vehicle that was learnt, by the frame alone a slow one.

    Args:
        image: uint8[h, w], f(t) on the canvas; so are all pictures.
        background: uint8[h, w], B(t - 1), rounded.
        valid: uint8[h, w], mask of where that is known.
        earlier: uint8[h, w], f(t - tau).
        earlier_seen: uint8[h, w], mask of what that covers.
        needed: uint8[h, w], T_F of each pixel, grey levels.
        mask: uint8[h, w], foreground.
        blocks: int32[n, 3], its pieces, see `pieces.pieces_of`.
        count: of the pieces.
        region: of the pictures, what is looked at.
        radius: how far off the background may be placed, px.
        way_x: from where things are to where they may have come from, px, see `slide`.
        way_y: the same, downwards.

    Returns:
        bool[count].
    """
    pixels, explained = np.zeros(count, np.int64), np.zeros(count, np.int64)
    beyond = 1.0 + EARLY_PX / np.sqrt(way_x * way_x + way_y * way_y)
    for index in range(0, len(blocks), max(1, -(-len(blocks) // MOST_POINTS))):
        row, column, piece = blocks[index, 0], blocks[index, 1], blocks[index, 2]
        # The other corner where this one is not in the mask; what has neither has a neighbour.
        other = int(mask[row, column] == 0)
        row, column = row + other, column + other
        if mask[row, column] == 0:
            continue
        pixels[piece] += 1
        # Signed, or what is below zero would be huge.
        value, most = np.int64(image[row, column]), np.int64(needed[row, column])
        low, high = value - most, value + most
        way = LAG * way_x, LAG * way_y
        if _explains(background, valid, 1, radius, row, column, way, low, high, region):
            way = beyond * way_x, beyond * way_y
            is_seen = _explains(earlier, earlier_seen, 0, 1, row, column, way, low, high, region)
            explained[piece] += int(is_seen)
    slides = np.zeros(count, np.bool_)
    for piece in range(count):
        slides[piece] = explained[piece] >= EXPLAINED * max(pixels[piece], 1)
    return slides


@compiled
def _explains(
    image: ByteImage,
    known: ByteImage,
    border: int,
    radius: int,
    row: int,
    column: int,
    way: tuple[float, float],
    low: np.int64,
    high: np.int64,
    region: Region,
) -> bool:
    """Whether the values along a way, each within the radius, take in some from `low` to `high`.

    What is not known, or nearer than `border` to that, explains nothing: a mover that comes into view was
    there, too.
    """
    top, bottom, left, right = region
    steps = int(np.rint(max(abs(way[0]), abs(way[1]))))
    lowest, highest = np.int64(255), np.int64(0)
    for step in range(steps + 1):
        part = step / max(steps, 1)
        y = min(max(row + int(np.rint(part * way[1])), top), bottom - 1)
        x = min(max(column + int(np.rint(part * way[0])), left), right - 1)
        if not _is_known(known, y, x, border, region):
            continue
        for there in range(max(y - radius, top), min(y + radius + 1, bottom)):
            for across in range(max(x - radius, left), min(x + radius + 1, right)):
                value = np.int64(image[there, across])
                lowest, highest = min(lowest, value), max(highest, value)
        if lowest <= high and highest >= low:
            return True
    return False


@compiled
def _is_known(known: ByteImage, row: int, column: int, border: int, region: Region) -> bool:
    top, bottom, left, right = region
    for y in range(max(row - border, top), min(row + border + 1, bottom)):
        for x in range(max(column - border, left), min(column + border + 1, right)):
            if known[y, x] == 0:
                return False
    return True
