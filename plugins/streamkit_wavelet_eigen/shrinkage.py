"""Kernels of wavelet shrinkage: noise estimate and soft threshold of each patch."""

import numpy as np
from numba import types
from numpy.typing import NDArray

from streamkit_kernels import kernel

COEFFICIENTS = types.Array(types.float32, 3, "C")
ROW = types.Array(types.float32, 1, "C")
# The median of |x| of a normal variable is 0.6745 standard deviations.
MEDIAN_TO_SIGMA = np.float32(0.6745)


@kernel(COEFFICIENTS, ROW)
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


@kernel(COEFFICIENTS, ROW, COEFFICIENTS)
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
