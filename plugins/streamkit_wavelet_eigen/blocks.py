"""A picture as a grid of equal blocks, row by row, and back."""

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.wavelet import FloatBatch


def cut_blocks(pictures: FloatBatch, blocks: int) -> FloatBatch:
    """Blocks float32[n, blocks * blocks, (h / blocks) * (w / blocks)] of pictures float32[n, h, w].

    Args:
        pictures: float32[n, h, w], h and w multiples of `blocks`.
        blocks: blocks per side; 1 makes each picture one vector.

    Source: Gottumukkal and Asari, An improved face recognition technique based on modular PCA approach, 2004.
    """
    count, height, width = pictures.shape
    parts = pictures.reshape(count, blocks, height // blocks, blocks, width // blocks)
    return parts.swapaxes(2, 3).reshape(count, blocks * blocks, height * width // (blocks * blocks))


def join_blocks(vectors: NDArray[np.floating], size: tuple[int, int]) -> FloatBatch:
    """Inverse of `cut_blocks`: float[n, blocks * blocks, d] to float32[n, h, w], `size` being (h, w)."""
    height, width = size
    count, parts = vectors.shape[:2]
    blocks = int(np.sqrt(parts))
    grid = vectors.reshape(count, blocks, blocks, height // blocks, width // blocks)
    return np.asarray(grid.swapaxes(2, 3).reshape(count, height, width), np.float32)
