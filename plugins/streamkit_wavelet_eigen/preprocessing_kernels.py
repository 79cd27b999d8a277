"""Kernels of preprocessing: histogram equalisation with the result of equalizeHist, and wavelet shrinkage."""

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_kernels import compiled, kernel

FloatBatch = NDArray[np.float32]
CountArray = NDArray[np.int64]
PATCHES = types.Array(types.float32, 3, "C")
ROW = types.Array(types.float32, 1, "C")
BANDS = types.Array(types.float32, 3, "A", readonly=True)
LEVELS = 256
# The LL band of a constant patch varies by float32 rounding, up to about 1e-4.
CONSTANT_SPAN = np.float32(1e-3)
# The median of |x| of a normal variable is 0.6745 standard deviations.
MEDIAN_TO_SIGMA = np.float32(0.6745)


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


@kernel(PATCHES, ROW)
def noise_deviations(coefficients: NDArray[np.float32], deviations: NDArray[np.float32]) -> None:
    """Noise deviation of each patch: median of |HH| / 0.6745.

    Args:
        coefficients: float32[n, h, w] with HH bottom right, h and w even.
        deviations: float32[n], output.
    """
    _, height, width = coefficients.shape
    magnitudes = np.empty((height // 2) * (width // 2), np.float32)
    for patch in range(len(coefficients)):
        index = 0
        for row in range(height // 2, height):
            for column in range(width // 2, width):
                magnitudes[index] = abs(coefficients[patch, row, column])
                index += 1
        # Twice the median is the float32 sum of the two middle values.
        doubled = np.float32(2.0 * np.median(magnitudes))
        deviations[patch] = doubled / np.float32(np.float32(2) * MEDIAN_TO_SIGMA)


@kernel(PATCHES, ROW, PATCHES)
def shrink_details(
    coefficients: NDArray[np.float32], limits: NDArray[np.float32], shrunk: NDArray[np.float32]
) -> None:
    """Soft threshold x - clip(x, -t, t) of all coefficients but LL, which is copied.

    Args:
        coefficients: float32[n, h, w] with LL top left.
        limits: float32[n], t of each patch.
        shrunk: float32[n, h, w], output.
    """
    _, height, width = coefficients.shape
    for patch in range(len(coefficients)):
        limit = limits[patch]
        for row in range(height):
            given, result = coefficients[patch, row], shrunk[patch, row]
            for column in range(width):
                value = given[column]
                result[column] = value - min(max(value, -limit), limit)
            if row < height // 2:
                result[: width // 2] = given[: width // 2]
