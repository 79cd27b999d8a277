"""Compiled comparison of two textures, block by block."""

from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray
from streamkit_kernels import FLOAT32, FLOAT64, FLOAT64_1D, compiled, kernel

SingleArray = npt.NDArray[np.float32]
BLOCK: Final = 8
# Every second pixel of a block is compared, as on the black squares of a chessboard: neighbours are alike.
PIXELS: Final = np.flatnonzero(np.indices((BLOCK, BLOCK)).sum(axis=0) % 2 == 0)
_AREA: Final = len(PIXELS)
# Difference of a block, as a part of both powers, at which it has a quarter of its weight, and at which it
# counts as a quarter of agreement; 1 is unrelated.
_UNLIKE: Final = 0.15
_RELATED: Final = 0.3
_WEAK_POWER: Final = 0.05


@kernel(FLOAT32, FLOAT64, FLOAT64, FLOAT32, FLOAT32, FLOAT32, FLOAT64_1D)
def compare_blocks(
    image: SingleArray,
    motion: FloatArray,
    origins: FloatArray,
    texture: SingleArray,
    across: SingleArray,
    down: SingleArray,
    power: FloatArray,
) -> FloatArray:
    """Compares blocks of 8 x 8 px of a keyframe with a frame.

    Args:
        image: float32[h, w], texture of the frame; at least a block in size, unless n is 0.
        motion: float64[3, 3], px of the keyframe to those of the frame.
        origins: float64[n, 2], x and y of the first pixel of each block.
        texture: float32[n, 32], of the keyframe at `PIXELS`, one row for each block.
        across: float32[n, 32], its gradient in x.
        down: float32[n, 32], its gradient in y.
        power: float64[n], mean square of `texture`.

    Returns:
        float64[6, n]: 1 where the frame fills the block, else 0; its weight, 0 to 1; the same for larger
        differences; the mean squared difference; and the mean products of the difference with the gradients.
        All are 0 where the frame does not fill the block.
    """
    height, width = image.shape
    pixels, matrix = image.reshape(height * width), motion.astype(np.float32)
    found, means = np.zeros((6, len(origins))), np.empty(4, np.float32)
    values, right, low = np.empty(_AREA, np.float32), np.empty(_AREA, np.float32), np.empty(_AREA, np.float32)
    first = np.empty(_AREA, np.int32)
    for block in range(len(origins)):
        left, top = origins[block]
        if not _is_inside(motion, left, top, width, height):
            continue
        _locate(matrix, np.float32(left), np.float32(top), width, height, first, right, low)
        for pixel in range(_AREA):
            at = first[pixel]
            upper, lower = pixels[at], pixels[at + width]
            upper += right[pixel] * (pixels[at + 1] - upper)
            lower += right[pixel] * (pixels[at + width + 1] - lower)
            values[pixel] = upper + low[pixel] * (lower - upper)
        _add_up(values, texture[block], across[block], down[block], means)
        part = means[0] / (power[block] + means[1] + _WEAK_POWER)
        found[0, block] = 1.0
        found[1, block] = 1 / (1 + (part / _UNLIKE) ** 2) ** 2
        found[2, block] = 1 / (1 + (part / _RELATED) ** 2) ** 2
        found[3, block], found[4, block], found[5, block] = means[0], means[2], means[3]
    return found


@compiled
def _is_inside(motion: FloatArray, left: float, top: float, width: int, height: int) -> bool:
    """Whether a frame shows all pixels of a block: those at its corners, as a homography keeps it convex."""
    for corner in range(4):
        x, y = left + (corner % 2) * (BLOCK - 1), top + (corner // 2) * (BLOCK - 1)
        depth = motion[2, 0] * x + motion[2, 1] * y + motion[2, 2]
        across = motion[0, 0] * x + motion[0, 1] * y + motion[0, 2]
        down = motion[1, 0] * x + motion[1, 1] * y + motion[1, 2]
        if not (depth > 0 and 0 <= across <= (width - 1) * depth and 0 <= down <= (height - 1) * depth):
            return False
    return True


@compiled
def _locate(
    matrix: SingleArray,
    left: np.float32,
    top: np.float32,
    width: int,
    height: int,
    first: npt.NDArray[np.int32],
    right: SingleArray,
    low: SingleArray,
) -> None:
    """Where the pixels of a block lie in the frame: of the four around each the first, and the rest, px."""
    # In registers: loops that store into arrays would load the matrix from memory again for each pixel.
    xx, xy, xo = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    yx, yy, yo = matrix[1, 0], matrix[1, 1], matrix[1, 2]
    zx, zy, zo = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    last_column, last_row, columns = np.int32(width - 2), np.int32(height - 2), np.int32(width)
    for pixel in range(_AREA):
        row = pixel * 2 // BLOCK
        x, y = left + np.float32(pixel * 2 % BLOCK + row % 2), top + np.float32(row)
        nearness = np.float32(1.0) / (zx * x + zy * y + zo)
        across, down = (xx * x + xy * y + xo) * nearness, (yx * x + yy * y + yo) * nearness
        column, line = min(np.int32(across), last_column), min(np.int32(down), last_row)
        first[pixel] = line * columns + column
        right[pixel], low[pixel] = across - np.float32(column), down - np.float32(line)


@compiled
def _add_up(
    values: SingleArray, texture: SingleArray, across: SingleArray, down: SingleArray, means: SingleArray
) -> None:
    squares = own = sideways = downwards = np.float32(0.0)
    for pixel in range(_AREA):
        value = values[pixel]
        difference = value - texture[pixel]
        squares += difference * difference
        own += value * value
        sideways += difference * across[pixel]
        downwards += difference * down[pixel]
    share = np.float32(1.0 / _AREA)
    means[0], means[1], means[2], means[3] = squares * share, own * share, sideways * share, downwards * share
