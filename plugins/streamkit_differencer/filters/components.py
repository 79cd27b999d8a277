"""Connected components of the foreground, for filters that classify each as a whole."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np
from numba import types

from streamkit_differencer.arrays import ByteImage, FloatImage, LabelImage
from streamkit_kernels import INT32, UINT8, UINT8_STRIDED, kernel

# A part of the canvas that is written to.
PART = types.Array(types.float32, 2, "A")


def components_of(mask: ByteImage) -> tuple[LabelImage, int]:
    """Connected components of a mask, of blocks of two by two pixels; an odd last row or column is left out.

    Args:
        mask: uint8[h, w].

    Returns:
        int32[n, 3], of each set block the row and the column of its first pixel, and its component, from 0;
        and the number of components.
    """
    height, width = mask.shape[0] // 2, mask.shape[1] // 2
    if not height or not width:
        return np.zeros((0, 3), np.int32), 0
    whole = mask[: 2 * height, : 2 * width]
    blocks = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    count, labels = cv2.connectedComponents(blocks, connectivity=8)
    if count == 1:
        return np.zeros((0, 3), np.int32), 0
    return _table_of(cast("LabelImage", labels)), count - 1


@kernel(INT32)
def _table_of(labels: LabelImage) -> LabelImage:
    """The blocks with a label, see `components_of`."""
    table, count = np.empty((labels.size, 3), np.int32), 0
    for row in range(labels.shape[0]):
        for column in range(labels.shape[1]):
            if labels[row, column] > 0:
                table[count, 0], table[count, 1] = 2 * row, 2 * column
                table[count, 2] = labels[row, column] - 1
                count += 1
    return table[:count].copy()


@kernel(INT32, UINT8, UINT8, UINT8_STRIDED, PART)
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
    for index in range(len(blocks)):
        for offset in range(4):
            row, column = blocks[index, 0] + offset // 2, blocks[index, 1] + offset % 2
            if mask[row, column] > 0 and quiet[row, column] > 0:
                background[row, column] = image[row, column]
            mask[row, column] = 0
