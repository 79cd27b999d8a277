"""Connected components of the foreground, for filters that classify each as a whole."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_differencer.arrays import FLOAT_OUTPUT, OUTPUT, ByteImage, Flags, FloatImage, LabelImage
from streamkit_kernels import BLOCKS, FLAGS, VIEW, kernel

Indices = NDArray[np.intp]

# Larger components are sampled.
MOST_POINTS = 1000


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
    if not cv2.countNonZero(blocks):
        return np.zeros((0, 3), np.int32), 0
    count, labels = cv2.connectedComponents(blocks, connectivity=8)
    columns, rows = cv2.findNonZero(blocks).reshape(-1, 2).T
    return np.column_stack([2 * rows, 2 * columns, labels[rows, columns] - 1]).astype(np.int32), count - 1


def component_pixels(mask: ByteImage, blocks: LabelImage) -> tuple[Indices, Indices, Indices]:
    """Rows, columns and component of the set pixels of some components, int[n] each."""
    rows, columns = (
        (blocks[:, axis, None] + np.array(steps)).ravel()
        for axis, steps in enumerate(((0, 0, 1, 1), (0, 1, 0, 1)))
    )
    is_set = mask[rows, columns] > 0
    return rows[is_set], columns[is_set], np.repeat(blocks[:, 2], 4)[is_set]


@kernel(BLOCKS, FLAGS, FLAGS, OUTPUT, VIEW, VIEW, FLOAT_OUTPUT)
def remove_components(
    blocks: LabelImage,
    ghosts: Flags,
    shifted: Flags,
    mask: ByteImage,
    quiet: ByteImage,
    image: ByteImage,
    background: FloatImage,
) -> None:
    """Removes components from the foreground, and learns them as background.

    Args:
        blocks: int32[n, 3], see `components_of`.
        ghosts: bool[components], those to learn at once.
        shifted: bool[components], those to learn where they are quiet, so that the background keeps up.
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of D = 0.
        image: uint8[h, w], f(t).
        background: float32[h, w], B.
    """
    for index in range(len(blocks)):
        component = blocks[index, 2]
        if not (ghosts[component] or shifted[component]):
            continue
        for row in range(blocks[index, 0], blocks[index, 0] + 2):
            for column in range(blocks[index, 1], blocks[index, 1] + 2):
                if mask[row, column] > 0:
                    mask[row, column] = 0
                    if ghosts[component] or quiet[row, column] > 0:
                        background[row, column] = image[row, column]
