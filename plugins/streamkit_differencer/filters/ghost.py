"""Ghosts: foreground where a thing was learnt as ground and has left."""

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
    Flags = NDArray[np.bool_]
    Blocks = NDArray[np.int32]

# So much of the outline must be so much stronger in the background than in the frame. A thing that is just
# leaving its ghost shows its own outline in front.
RATIO = 1.5
LEAST_EDGE = 8.0
AGREEMENT = 0.75
# Outlines nearer than this to what is not known tell nothing, px.
BORDER_PX = 2


@kernel(BYTES, BYTES, BYTES, BYTES, BLOCKS, types.int64, REGION)
def find_ghosts(
    image: ByteImage,
    background: ByteImage,
    valid: ByteImage,
    mask: ByteImage,
    blocks: Blocks,
    count: int,
    region: Region,
) -> Flags:
    """The pieces of foreground whose outline shows in the background and not in the frame.

    Args:
        image: uint8[h, w], f(t) on the canvas; so are all pictures.
        background: uint8[h, w], B(t - 1), rounded.
        valid: uint8[h, w], mask of where that is known.
        mask: uint8[h, w], foreground.
        blocks: int32[n, 3], its pieces, see `pieces_of`.
        count: of the pieces.
        region: of the pictures, what is looked at.

    Returns:
        bool[count].

    Source: the idea of Cucchiara, Grana, Piccardi and Prati, "Detecting Moving Objects, Ghosts, and Shadows
        in Video Streams", PAMI 2003, with edges for their optical flow.
    """
    length, sure, votes = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros(count, np.int64)
    outline = _outline(mask, blocks, region)
    # Of a long outline a share is asked.
    for index in range(0, len(outline), max(1, -(-len(outline) // MOST_POINTS))):
        row, column, piece = outline[index, 0], outline[index, 1], outline[index, 2]
        length[piece] += 1
        if _is_known(valid, row, column, region):
            sure[piece] += 1
            here, there = _range(image, row, column, region), _range(background, row, column, region)
            votes[piece] += int(there > RATIO * here + LEAST_EDGE)
    ghosts = np.zeros(count, np.bool_)
    for piece in range(count):
        agrees = votes[piece] >= AGREEMENT * max(sure[piece], 1)
        ghosts[piece] = agrees and 2 * sure[piece] >= length[piece]
    return ghosts


@compiled
def _outline(mask: ByteImage, blocks: Blocks, region: Region) -> Blocks:
    """Pixels at the edge of the foreground, int32[n, 3]: row, column and piece."""
    found = np.empty((4 * len(blocks), 3), np.int32)
    total = 0
    for index in range(len(blocks)):
        for place in range(4):
            row, column = blocks[index, 0] + place // 2, blocks[index, 1] + place % 2
            if mask[row, column] > 0 and _is_edge(mask, row, column, region):
                found[total, 0], found[total, 1], found[total, 2] = row, column, blocks[index, 2]
                total += 1
    return found[:total]


@compiled
def _is_edge(mask: ByteImage, row: int, column: int, region: Region) -> bool:
    top, bottom, left, right = region
    for y in range(max(row - 1, top), min(row + 2, bottom)):
        for x in range(max(column - 1, left), min(column + 2, right)):
            if mask[y, x] == 0:
                return True
    return False


@compiled
def _is_known(valid: ByteImage, row: int, column: int, region: Region) -> bool:
    top, bottom, left, right = region
    for y in range(max(row - BORDER_PX, top), min(row + BORDER_PX + 1, bottom)):
        for x in range(max(column - BORDER_PX, left), min(column + BORDER_PX + 1, right)):
            if valid[y, x] == 0:
                return False
    return True


@compiled
def _range(image: ByteImage, row: int, column: int, region: Region) -> int:
    """The range of values within a pixel."""
    top, bottom, left, right = region
    low, high = np.int64(255), np.int64(0)
    for y in range(max(row - 1, top), min(row + 2, bottom)):
        for x in range(max(column - 1, left), min(column + 2, right)):
            value = np.int64(image[y, x])
            low, high = min(low, value), max(high, value)
    return int(high - low)
