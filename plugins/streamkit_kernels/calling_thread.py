"""Matrix products that stay on the calling thread.

OpenBLAS wakes its own threads for products of more than about 2^18 multiplications. Elements run in parallel
on their own threads; waiting for a busy core then costs forty times the product itself. Smaller blocks are
computed on the calling thread, and give the same bits for any number of cores.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

MAX_PRODUCT = 2**18
MIN_SUM = 32
MIN_ROWS = 8

Real = TypeVar("Real", np.float32, np.float64)


def product(left: NDArray[Real], right: NDArray[Real]) -> NDArray[Real]:
    """The product left @ right in blocks too small for BLAS to use other threads.

    Args:
        left: float32 or float64[..., n, p].
        right: of the same type[..., p, k], its leading axes broadcast against those of `left`.

    Returns:
        Of the same type[..., n, k].
    """
    count, inner, columns = left.shape[-2], left.shape[-1], right.shape[-1]
    lead: tuple[int, ...] = ()
    if not left.ndim == right.ndim == 2:
        lead = np.broadcast_shapes(left.shape[:-2], right.shape[:-2])
    out = np.empty((*lead, count, columns), left.dtype)
    depth = MAX_PRODUCT // max(count * columns, 1)
    if depth >= inner:
        np.matmul(left, right, out=out)
        return out
    block = max(1, MAX_PRODUCT // max(inner * columns, 1))
    if depth >= MIN_SUM and block < MIN_ROWS:
        # Long sums over few columns: splitting the sum reads `right` once, splitting rows once per block.
        np.matmul(left[..., :depth], right[..., :depth, :], out=out)
        for start in range(depth, inner, depth):
            part = slice(start, start + depth)
            out += left[..., part] @ right[..., part, :]
        return out
    for start in range(0, count, block):
        rows = slice(start, start + block)
        np.matmul(left[..., rows, :], right, out=out[..., rows, :])
    return out
