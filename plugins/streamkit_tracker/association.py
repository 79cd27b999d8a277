"""Which detection belongs to which target."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from streamkit_tracker.window_geometry import FloatArray

FORBIDDEN = 1e6


def mahalanobis_squared(
    positions: FloatArray, covariances: FloatArray, centroids: FloatArray, centroid_std: FloatArray
) -> FloatArray:
    """Squared distances of every centroid to every predicted position, in standard deviations.

    Args:
        positions: float64[t, 2], px.
        covariances: float64[t, 2, 2], px squared.
        centroids: float64[d, 2], px.
        centroid_std: float64[t, d], standard deviation of a centroid for each pair, px.

    Returns:
        float64[t, d].
    """
    variance = centroid_std**2
    xx, yy = covariances[:, :1, 0] + variance, covariances[:, 1:, 1] + variance
    xy = covariances[:, :1, 1]
    across = centroids[:, 0] - positions[:, :1]
    down = centroids[:, 1] - positions[:, 1:]
    determinant = np.maximum(xx * yy - xy**2, 1e-12)
    return np.asarray((yy * across**2 - 2 * xy * across * down + xx * down**2) / determinant)


def assign(costs: FloatArray, allowed: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Pairs rows and columns at the least total cost; pairs that are not allowed stay apart.

    Args:
        costs: float64[t, d], finite where allowed.
        allowed: bool[t, d].

    Returns:
        Pairs (row, column), in order of the rows.

    Source: Kuhn, The Hungarian method, 1955, as in scipy's linear_sum_assignment.
    """
    if costs.size == 0 or not allowed.any():
        return []
    rows, columns = linear_sum_assignment(np.where(allowed, costs, FORBIDDEN))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if allowed[r, c]]
