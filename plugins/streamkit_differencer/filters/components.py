"""Connected components of the foreground, for filters that classify each as a whole."""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import ByteImage, ByteLine, FloatImage, Indices, LabelImage, find_set
from streamkit_kernels import INT32, UINT8, compiled, kernel


def components_of(mask: ByteImage) -> tuple[LabelImage, int]:
    """Connected components of a mask, of blocks of two by two pixels; an odd last row or column is left out.

    Args:
        mask: uint8[h, w].

    Returns:
        int32[n, 3], line by line, of each set block the row and the column of its first pixel, and its
        component, from 0; and the number of components.
    """
    blocks = set_blocks(mask)
    return blocks, label_blocks(blocks, mask.shape[1])


@kernel(UINT8)
def set_blocks(mask: ByteImage) -> LabelImage:
    """The blocks of a mask of which a pixel is set, see `components_of`, all of component 0."""
    height, width = mask.shape[0] // 2, mask.shape[1] // 2
    blocks, count = np.empty((height * width, 3), np.int32), 0
    united, columns = np.empty(2 * width, np.uint8), np.empty(2 * width, np.int64)
    for row in range(height):
        _unite(mask[2 * row], mask[2 * row + 1], united)
        last = -1
        for column in columns[: find_set(united, columns)]:
            if column // 2 != last:
                last = column // 2
                blocks[count, 0], blocks[count, 1], blocks[count, 2] = 2 * row, 2 * last, 0
                count += 1
    return blocks[:count].copy()


@compiled
def _unite(upper: ByteLine, lower: ByteLine, united: ByteLine) -> None:
    for index in range(united.size):
        united[index] = upper[index] | lower[index]


@kernel(INT32, types.int64)
def label_blocks(blocks: LabelImage, width: int) -> int:
    """Numbers the connected components of blocks; returns how many there are.

    Args:
        blocks: int32[n, 3], see `components_of`; the components are written.
        width: of the mask, px.

    Source: the union-find of Fiorio and Gustedt, "Two linear time Union-Find strategies for image
        processing", 1996, with eight neighbours.
    """
    # Of each block an earlier one of its component; of each column the last block, from 1.
    parents, line = np.arange(len(blocks)), np.zeros((2, width // 2 + 2), np.int64)
    for index in range(len(blocks)):
        row, column = blocks[index, 0] // 2, blocks[index, 1] // 2
        here, above = line[row % 2], line[1 - row % 2]
        for near in (here[column], above[column], above[column + 1], above[column + 2]):
            if near > 0 and row - blocks[near - 1, 0] // 2 <= 1:
                first, second = _root(parents, near - 1), _root(parents, index)
                parents[max(first, second)] = min(first, second)
        here[column + 1] = index + 1
    count = 0
    for index in range(len(blocks)):
        if parents[index] == index:
            blocks[index, 2], count = count, count + 1
        else:
            blocks[index, 2] = blocks[parents[index], 2]
    return count


@compiled
def _root(parents: Indices, index: int) -> int:
    while parents[index] != index:
        parents[index] = parents[parents[index]]
        index = parents[index]
    return index


def remove_blocks(
    blocks: LabelImage,
    mask: ByteImage,
    quiet: ByteImage,
    image: ByteImage,
    background: FloatImage,
) -> None:
    """Removes blocks from the foreground, and learns them where they are quiet: the background keeps up.

    Args:
        blocks: int32[n, 3], see `components_of`.
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of D = 0.
        image: uint8[h, w], f(t).
        background: float32[h, w], B.
    """
    rows = (blocks[:, :1] + (0, 0, 1, 1)).ravel()
    columns = (blocks[:, 1:2] + (0, 1, 0, 1)).ravel()
    learnt = (mask[rows, columns] > 0) & (quiet[rows, columns] > 0)
    pixels = rows[learnt], columns[learnt]
    background[pixels] = image[pixels]
    mask[rows, columns] = 0
