"""Kernels of histogram equalisation of patches, with the result of OpenCV's equalizeHist."""

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_kernels import compiled, kernel

FloatBatch = NDArray[np.float32]
CountArray = NDArray[np.int64]
PATCHES = types.Array(types.float32, 3, "C")
BANDS = types.Array(types.float32, 3, "A", readonly=True)
LEVELS = 256
# The LL band of a constant patch varies by float32 rounding, up to about 1e-4.
CONSTANT_SPAN = np.float32(1e-3)


@kernel(PATCHES)
def equalise(patches: FloatBatch) -> None:
    """Equalises the grey histogram of each patch float32[n, h, w] in place; levels are clipped to 0..255."""
    counts, table = np.empty(LEVELS, np.int64), np.empty(LEVELS, np.float32)
    for patch in range(len(patches)):
        _equalise_levels(patches[patch].reshape(-1), counts, table)


@kernel(BANDS, PATCHES)
def equalise_own_range(bands: FloatBatch, equalised: FloatBatch) -> None:
    """Equalises each band within its own minimum and maximum.

    Args:
        bands: float32[n, h, w].
        equalised: float32[n, h, w], output.
    """
    counts, table = np.empty(LEVELS, np.int64), np.empty(LEVELS, np.float32)
    for index in range(len(bands)):
        band, result = bands[index], equalised[index]
        lowest, span = band.min(), np.float32(band.max() - band.min())
        scale = np.float32(255.0) / span if span > CONSTANT_SPAN else np.float32(0.0)
        result[:] = (band - lowest) * scale
        _equalise_levels(result.reshape(-1), counts, table)
        result[:] = result * np.float32(span / np.float32(255.0)) + lowest


@compiled
def _equalise_levels(levels: NDArray[np.float32], counts: CountArray, table: NDArray[np.float32]) -> None:
    """Equalises float32[n] in place; `counts` int64[256] and `table` float32[256] are overwritten."""
    counts[:] = 0
    low, high = np.float32(0.0), np.float32(LEVELS - 1)
    for index in range(len(levels)):
        level = np.rint(min(max(levels[index], low), high))
        levels[index] = level
        counts[np.uint8(level)] += 1
    first = 0
    while counts[first] == 0:
        first += 1
    table[first] = np.float32(first if counts[first] == len(levels) else 0)
    scale = np.float32(LEVELS - 1) / np.float32(max(len(levels) - counts[first], 1))
    total = 0
    for level in range(first + 1, LEVELS):
        total += counts[level]
        table[level] = np.rint(np.float32(total) * scale)
    for index in range(len(levels)):
        levels[index] = table[np.uint8(levels[index])]
