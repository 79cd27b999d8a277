"""Soft thresholds of wavelet coefficients against each patch's own noise."""

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_kernels import compiled, kernel

FloatBatch = NDArray[np.float32]
FloatRow = NDArray[np.float32]
COEFFICIENTS = types.Array(types.float32, 3, "C")
ROW = types.Array(types.float32, 1, "C")
# The median of |x| of a normal variable is 0.6745 standard deviations.
MEDIAN_TO_SIGMA = np.float32(0.6745)


@kernel(COEFFICIENTS, ROW)
def noise_deviations(coefficients: FloatBatch, deviations: FloatRow) -> None:
    """Fills in the noise deviation of each patch, float32[n]: median of |HH| / 0.6745.

    `coefficients` is float32[n, h, w] with HH bottom right, h and w even.
    """
    _, height, width = coefficients.shape
    magnitudes = np.empty((height // 2) * (width // 2), np.float32)
    for patch in range(len(coefficients)):
        place = 0
        for row in range(height // 2, height):
            for column in range(width // 2, width):
                magnitudes[place] = abs(coefficients[patch, row, column])
                place += 1
        middle = place // 2
        upper = _select(magnitudes, middle)
        lower = upper if place % 2 else magnitudes[:middle].max()
        deviations[patch] = np.float32(lower + upper) / np.float32(np.float32(2) * MEDIAN_TO_SIGMA)


@kernel(COEFFICIENTS, ROW, COEFFICIENTS)
def shrink_details(coefficients: FloatBatch, limits: FloatRow, shrunk: FloatBatch) -> None:
    """Soft threshold x - clip(x, -t, t) of all coefficients but LL, which are copied.

    Args:
        coefficients: float32[n, h, w] with LL top left.
        limits: float32[n], t for each patch.
        shrunk: float32[n, h, w], is filled.
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


@compiled
def _select(values: FloatRow, rank: int) -> float:
    """The value that sorting would put at `rank`; smaller ones end before it (Hoare's quickselect)."""
    low, high = 0, len(values) - 1
    while low < high:
        pivot = values[(low + high) // 2]
        left, right = low, high
        while left <= right:
            while values[left] < pivot:
                left += 1
            while values[right] > pivot:
                right -= 1
            if left <= right:
                values[left], values[right] = values[right], values[left]
                left += 1
                right -= 1
        if rank <= right:
            high = right
        elif rank >= left:
            low = left
        else:
            break
    return float(values[rank])
