"""Optimal assignment of rows to columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from streamkit_tracker.window_geometry import FloatArray

FORBIDDEN = 1e6


def assign(costs: FloatArray, allowed: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Pairs rows and columns at the least total cost; pairs that are not allowed stay apart.

    Args:
        costs: float64[t, d], finite where allowed.
        allowed: bool[t, d].

    Returns:
        Pairs (row, column), in order of the rows.
    """
    finite = np.where(allowed, np.fmin(costs, FORBIDDEN), FORBIDDEN)
    pairs = zip(*(index.tolist() for index in linear_sum_assignment(finite)), strict=True)
    return [pair for pair in pairs if allowed[pair]]
