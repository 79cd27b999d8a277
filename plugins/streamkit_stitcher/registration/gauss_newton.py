"""Gauss-Newton steps of a homography on weighted point pairs.

A step is a homography near the identity, in normalised coordinates, in which points are of unit size about
the origin: `scaling` float64[3] is that origin, x y, and the unit, px. The eight parameters of a step,
float64[8], are h11 - 1, h12, h13, h21, h22 - 1, h23, h31, h32, times the unit.

Source: Hartley, In defense of the eight-point algorithm, PAMI 1997.
"""

import math

import cv2
import numpy as np
from numba import types

from streamkit.geometry.homography import FloatArray, inverse, normalised, project
from streamkit_kernels import kernel

_POINTS = types.Array(types.float64, 2, "A", readonly=True)


@kernel(_POINTS)
def scaling_of(points: FloatArray) -> FloatArray:
    """The scaling that normalises float64[n, 2] points, n >= 1."""
    scaling = np.zeros(3)
    for point in range(len(points)):
        scaling[0] += points[point, 0]
        scaling[1] += points[point, 1]
    x, y, unit = scaling[0] / len(points), scaling[1] / len(points), 1.0
    for point in range(len(points)):
        unit = max(unit, abs(points[point, 0] - x), abs(points[point, 1] - y))
    scaling[0], scaling[1], scaling[2] = x, y, unit
    return scaling


def slopes(points: FloatArray, scaling: FloatArray) -> FloatArray:
    """Derivatives of the x and y of float64[n, 2] points by the parameters of a step, float64[2, 8, n]."""
    x, y = ((points - scaling[:2]) / scaling[2]).T
    both = np.zeros((2, 8, len(points)))
    both[0, 0] = both[1, 3] = x
    both[0, 1] = both[1, 4] = y
    both[0, 2] = both[1, 5] = 1
    both[0, 6], both[0, 7], both[1, 7] = -x * x, -x * y, -y * y
    both[1, 6] = both[0, 7]
    return both


def step_matrix(parameters: FloatArray, scaling: FloatArray) -> FloatArray:
    """The homography of a step, float64[3, 3], px."""
    step, to_px = np.eye(3), _to_px(scaling)
    step.ravel()[:8] += parameters / scaling[2]
    return normalised(to_px @ step @ inverse(to_px))


def step_parameters(matrix: FloatArray, scaling: FloatArray) -> FloatArray:
    """The parameters of a homography near the identity; the inverse of `step_matrix`."""
    to_px = _to_px(scaling)
    step = normalised(inverse(to_px) @ matrix @ to_px) - np.eye(3)
    return np.asarray(step.ravel()[:8] * scaling[2])


def _to_px(scaling: FloatArray) -> FloatArray:
    x, y, unit = scaling.tolist()
    return np.array([[unit, 0, x], [0, unit, y], [0, 0, 1]])


def gauss_newton_step(
    matrix: FloatArray, source: FloatArray, target: FloatArray, weights: FloatArray
) -> FloatArray | None:
    """The homography after one weighted Gauss-Newton step, or None for degenerate points.

    Args:
        matrix: source to target.
        source: float64[n, 2].
        target: float64[n, 2].
        weights: float64[n], 0 or more.
    """
    mapped, scaling = project(matrix, source), scaling_of(target)
    rows = np.concatenate(slopes(mapped, scaling), axis=1)
    counted = rows * np.tile(weights, 2)
    sides = counted @ (target - mapped).T.ravel()
    solved, step = cv2.solve(counted @ rows.T, sides[:, np.newaxis], flags=cv2.DECOMP_CHOLESKY)
    return normalised(step_matrix(np.asarray(step[:, 0], np.float64), scaling) @ matrix) if solved else None


def deviation_at(points: FloatArray, matrix: FloatArray, source: FloatArray, rmse: float) -> float:
    """Standard deviation of a fitted homography at the worst of some points, px of the target.

    Args:
        points: float64[m, 2], of the source.
        matrix: source to target.
        source: float64[n, 2], the points it was fitted to.
        rmse: root mean square residual.

    Source: Hartley and Zisserman, Multiple View Geometry, section 5.2.
    """
    if 2 * len(source) <= 8:
        return math.inf
    mapped = project(matrix, source)
    scaling = scaling_of(mapped)
    rows = np.concatenate(slopes(mapped, scaling), axis=1)
    try:
        covariance = np.linalg.inv(rows @ rows.T) * rmse**2 * len(source) / (2 * len(source) - 8)
    except np.linalg.LinAlgError:
        return math.inf
    return worst_deviation(covariance, scaling, project(matrix, points))


def worst_deviation(covariance: FloatArray, scaling: FloatArray, points: FloatArray) -> float:
    """Standard deviation of a motion at the worst of some points, px.

    Args:
        covariance: float64[8, 8], of the parameters of a step, px squared.
        scaling: that of the step.
        points: float64[n, 2].
    """
    both = slopes(points, scaling)
    # The variances of x and y add up.
    worst = float((both * (covariance @ both)).sum(axis=(0, 1)).max())
    return math.sqrt(worst) if worst >= 0 else math.inf
