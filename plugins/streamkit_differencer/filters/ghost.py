"""Ghosts: foreground where an object was learnt as background and has moved away."""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import ByteImage, Flags, LabelImage
from streamkit_differencer.equations import LONGEST_WAIT
from streamkit_differencer.filters.components import is_all_set
from streamkit_kernels import INT32, UINT8_STRIDED, compiled, kernel

# Share of the outline that must be stronger in the background than in the frame, and by how much. An object
# that is just leaving its ghost hides a part of the ghost's outline.
RATIO = 1.5
LEAST_EDGE = 8.0
AGREEMENT = 0.75
# Frames without change of uncovered ground, in the same share of its pixels; leaves that blur what they cover
# move on.
REST_FRAMES = 6
# Outlines within this distance of unknown background do not count, px.
BORDER_PX = 2


@kernel(*[UINT8_STRIDED] * 5, INT32, types.int64)
def find_ghosts(
    image: ByteImage,
    background: ByteImage,
    valid: ByteImage,
    waiting: ByteImage,
    mask: ByteImage,
    blocks: LabelImage,
    count: int,
) -> Flags:
    """The components of foreground at rest whose outline shows in the background and not in the frame.

    Args:
        image: uint8[h, w], f(t), as all images.
        background: uint8[h, w], B(t - 1), rounded.
        valid: uint8[h, w], not 0 where it is known.
        waiting: uint8[h, w], the counter D, see `equations.count_down`.
        mask: uint8[h, w], foreground.
        blocks: int32[n, 3], its components, see `components_of`.
        count: number of components.

    Returns:
        bool[count].

    Source: after Cucchiara, Grana, Piccardi and Prati, "Detecting Moving Objects, Ghosts, and Shadows
        in Video Streams", PAMI 2003, with edges instead of optical flow.
    """
    pixels, rest = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for index in range(len(blocks)):
        for offset in range(4):
            row, column = blocks[index, 0] + offset // 2, blocks[index, 1] + offset % 2
            if mask[row, column] > 0:
                pixels[blocks[index, 2]] += 1
                rest[blocks[index, 2]] += int(waiting[row, column] <= LONGEST_WAIT - REST_FRAMES)
    length, known, votes = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros(count, np.int64)
    rests = rest >= AGREEMENT * pixels
    for index in range(len(blocks)):
        component = blocks[index, 2]
        for offset in range(4 if rests[component] else 0):
            row, column = blocks[index, 0] + offset // 2, blocks[index, 1] + offset % 2
            if mask[row, column] == 0 or is_all_set(mask, row, column, 1):
                continue
            length[component] += 1
            if is_all_set(valid, row, column, BORDER_PX):
                known[component] += 1
                edge = _range_around(image, row, column)
                votes[component] += int(_range_around(background, row, column) > RATIO * edge + LEAST_EDGE)
    return rests & (votes >= AGREEMENT * np.maximum(known, 1)) & (2 * known >= length)


@compiled
def _range_around(image: ByteImage, row: int, column: int) -> int:
    """The range of values among a pixel and its neighbours."""
    low, high = np.int64(255), np.int64(0)
    for y in range(max(row - 1, 0), min(row + 2, image.shape[0])):
        for x in range(max(column - 1, 0), min(column + 2, image.shape[1])):
            low, high = min(low, np.int64(image[y, x])), max(high, np.int64(image[y, x]))
    return int(high - low)
