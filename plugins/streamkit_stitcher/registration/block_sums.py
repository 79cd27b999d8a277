"""Compiled comparison of two textures, block by block."""

from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit_kernels import FLOAT32, compiled, kernel

SingleArray = npt.NDArray[np.float32]
SingleLine = npt.NDArray[np.float32]
BLOCK: Final = 8


@kernel(FLOAT32, FLOAT32, FLOAT32, FLOAT32)
def compare_blocks(
    moved: SingleArray, texture: SingleArray, across: SingleArray, down: SingleArray
) -> SingleArray:
    """Means over blocks of 8 x 8 px, float32[4, rows, columns], of what a frame differs by from a keyframe.

    Args:
        moved: float32[h, w], texture of the frame on the keyframe, NaN where it does not show it.
        texture: float32[h, w], of the keyframe.
        across: float32[h, w], its gradient in x.
        down: float32[h, w], its gradient in y.

    Returns:
        The squared difference, the square of `moved`, and the products of the difference with the gradients;
        NaN for blocks that the frame does not fill. A remainder at the right and bottom is left out.
    """
    rows, columns = max(1, moved.shape[0] // BLOCK), max(1, moved.shape[1] // BLOCK)
    height, width = min(BLOCK, moved.shape[0]), min(BLOCK, moved.shape[1])
    means = np.empty((4, rows, columns), np.float32)
    sums = np.empty((4, columns * width), np.float32)
    share = np.float32(1.0 / (height * width))
    for row in range(rows):
        sums[:] = np.float32(0.0)
        for line in range(row * height, (row + 1) * height):
            _add_line(moved[line], texture[line], across[line], down[line], sums)
        for kind in range(4):
            for column in range(columns):
                total = np.float32(0.0)
                for index in range(column * width, (column + 1) * width):
                    total += sums[kind, index]
                means[kind, row, column] = total * share
    return means


@compiled
def _add_line(
    moved: SingleLine, texture: SingleLine, across: SingleLine, down: SingleLine, sums: SingleArray
) -> None:
    for index in range(sums.shape[1]):
        value = moved[index]
        difference = value - texture[index]
        sums[0, index] += difference * difference
        sums[1, index] += value * value
        sums[2, index] += difference * across[index]
        sums[3, index] += difference * down[index]
