"""Connected components of the foreground, for filters that classify each as a whole."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatImage, LabelImage


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
    columns, rows = np.reshape(cv2.findNonZero(blocks), (-1, 2)).T
    table = np.column_stack([2 * rows, 2 * columns, labels[rows, columns] - 1])
    return cast("LabelImage", table), count - 1


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
    places = rows[learnt], columns[learnt]
    background[places] = image[places]
    mask[rows, columns] = 0
