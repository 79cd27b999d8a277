"""Matrix products that stay on the calling thread.

OpenBLAS wakes its own threads for products of more than about 2^18 multiplications. Elements run side by side
on threads of their own; waiting for a busy core then costs forty times the product itself. Blocks below that
size are computed where they are asked for, and give the same bits whatever the number of cores.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LARGEST_PRODUCT = 2**18
SHORTEST_SUM = 32
FEWEST_ROWS = 8

Float32Array = NDArray[np.float32]


def product(left: Float32Array, right: Float32Array, out: Float32Array | None = None) -> Float32Array:
    """The product left @ right in blocks that no BLAS hands to other threads.

    Args:
        left: float32[..., n, p].
        right: float32[..., p, k], its leading axes broadcast against those of `left`.
        out: float32[..., n, k] to write to, or None for a new array.
    """
    count, inner, columns = *left.shape[-2:], right.shape[-1]
    if out is None:
        flat = left.ndim == right.ndim == 2
        lead = () if flat else np.broadcast_shapes(left.shape[:-2], right.shape[:-2])
        out = np.empty((*lead, count, columns), np.float32)
    depth = LARGEST_PRODUCT // max(count * columns, 1)
    if depth >= inner:
        return np.matmul(left, right, out=out)
    block = max(1, LARGEST_PRODUCT // max(inner * columns, 1))
    if depth >= SHORTEST_SUM and block < FEWEST_ROWS:
        # long sums over few columns: cutting the sum reads the right side once, cutting rows once per block
        np.matmul(left[..., :depth], right[..., :depth, :], out=out)
        for start in range(depth, inner, depth):
            part = slice(start, start + depth)
            out += left[..., part] @ right[..., part, :]
        return out
    for start in range(0, count, block):
        rows = slice(start, start + block)
        np.matmul(left[..., rows, :], right, out=out[..., rows, :])
    return out
