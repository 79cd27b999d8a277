"""Cuts images into a grid of equal blocks, row by row, and joins them again."""

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.wavelet import FloatBatch


def cut_blocks(images: FloatBatch, blocks: int) -> FloatBatch:
    """Blocks float32[n, blocks * blocks, (h / blocks) * (w / blocks)] of float32[n, h, w].

    `blocks` is their number per side, a divisor of h and w.

    Source: Gottumukkal and Asari, An improved face recognition technique based on modular PCA approach, 2004.
    """
    count, height, width = images.shape
    parts = images.reshape(count, blocks, height // blocks, blocks, width // blocks)
    return parts.swapaxes(2, 3).reshape(count, blocks * blocks, height * width // (blocks * blocks))


def join_blocks(vectors: NDArray[np.floating], size: tuple[int, int]) -> FloatBatch:
    """Inverse of `cut_blocks`: float[n, blocks * blocks, d] to float32[n, h, w], `size` being (h, w)."""
    height, width = size
    count, parts = vectors.shape[:2]
    blocks = int(np.sqrt(parts))
    grid = vectors.reshape(count, blocks, blocks, height // blocks, width // blocks)
    return np.asarray(grid.swapaxes(2, 3).reshape(count, height, width), np.float32)
