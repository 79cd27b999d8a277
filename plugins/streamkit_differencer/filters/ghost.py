"""Ghosts: foreground where an object was learnt as background and has moved away."""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import REGION, ByteImage, Flags, LabelImage, Region
from streamkit_differencer.changes import LONGEST_WAIT
from streamkit_differencer.filters.components import MOST_POINTS
from streamkit_differencer.lines import is_known, local_range
from streamkit_kernels import BLOCKS, BYTES, compiled, kernel

# Share of the outline that must be stronger in the background than in the frame, and by how much. An object
# that is just leaving its ghost hides a part of the ghost's outline.
RATIO = 1.5
LEAST_EDGE = 8.0
AGREEMENT = 0.75
# Frames without change of uncovered ground, in the same share of its pixels; leaves that blur what they cover
# move on.
REST_FRAMES = 6
# Outlines nearer than this to unknown background do not count, px.
BORDER_PX = 2


@kernel(*[BYTES] * 5, BLOCKS, types.int64, REGION)
def find_ghosts(
    image: ByteImage,
    background: ByteImage,
    valid: ByteImage,
    waiting: ByteImage,
    mask: ByteImage,
    blocks: LabelImage,
    count: int,
    region: Region,
) -> Flags:
    """The components of foreground at rest whose outline shows in the background and not in the frame.

    Args:
        image: uint8[h, w], f(t) on the canvas, as all images.
        background: uint8[h, w], B(t - 1), rounded.
        valid: uint8[h, w], mask of where it is known.
        waiting: uint8[h, w], the counter of `changes.update_waiting`.
        mask: uint8[h, w], foreground.
        blocks: int32[n, 3], its components, see `components_of`.
        count: number of components.
        region: of the images.

    Returns:
        bool[count].

    Source: after Cucchiara, Grana, Piccardi and Prati, "Detecting Moving Objects, Ghosts, and Shadows
        in Video Streams", PAMI 2003, with edges instead of optical flow.
    """
    length, known, votes = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros(count, np.int64)
    pixels, rest = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for index in range(len(blocks)):
        for offset in range(4):
            row, column = blocks[index, 0] + offset // 2, blocks[index, 1] + offset % 2
            if mask[row, column] > 0:
                pixels[blocks[index, 2]] += 1
                rest[blocks[index, 2]] += int(waiting[row, column] <= LONGEST_WAIT - REST_FRAMES)
    outline = _outline(mask, blocks, region)
    # A long outline is sampled.
    for index in range(0, len(outline), max(1, -(-len(outline) // MOST_POINTS))):
        row, column, component = outline[index, 0], outline[index, 1], outline[index, 2]
        length[component] += 1
        if is_known(valid, row, column, BORDER_PX, region):
            known[component] += 1
            edge = local_range(image, row, column, region)
            votes[component] += int(local_range(background, row, column, region) > RATIO * edge + LEAST_EDGE)
    ghosts = np.zeros(count, np.bool_)
    for component in range(count):
        agrees = votes[component] >= AGREEMENT * max(known[component], 1)
        rests = rest[component] >= AGREEMENT * pixels[component]
        ghosts[component] = agrees and rests and 2 * known[component] >= length[component]
    return ghosts


@compiled
def _outline(mask: ByteImage, blocks: LabelImage, region: Region) -> LabelImage:
    """Pixels at the edge of the foreground, int32[n, 3]: row, column and component."""
    found = np.empty((4 * len(blocks), 3), np.int32)
    total = 0
    for index in range(len(blocks)):
        for offset in range(4):
            row, column = blocks[index, 0] + offset // 2, blocks[index, 1] + offset % 2
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
