"""Gauss-Newton steps of a homography on weighted point pairs."""

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray, corners, normalised, project

# Derivatives of a point's x and y by the eight parameters of a homography near the identity, by monomials.
_ACROSS: Final[FloatArray] = np.zeros((8, 6))
_ACROSS[[0, 1, 2, 6, 7], [3, 4, 5, 0, 1]] = 1, 1, 1, -1, -1
_DOWN: Final[FloatArray] = np.zeros((8, 6))
_DOWN[[3, 4, 5, 6, 7], [3, 4, 5, 1, 2]] = 1, 1, 1, -1, -1


@dataclass(frozen=True, eq=False)
class Scaling:
    """Normalised coordinates, in which points are of unit size about the origin.

    Attributes:
        middle: float64[2].
        size: half the side of the points' bounding box.
        forth: normalised coordinates to px.
        back: its inverse.

    Source: Hartley, In defense of the eight-point algorithm, PAMI 1997.
    """

    middle: FloatArray
    size: float
    forth: FloatArray
    back: FloatArray

    @classmethod
    def of(cls, points: FloatArray) -> "Scaling":
        """Normalises float64[n, 2] points, n >= 1."""
        middle = np.add.reduce(points) / len(points)
        size = max(1.0, float(np.abs(points - middle).max()))
        forth = np.array([[size, 0, middle[0]], [0, size, middle[1]], [0, 0, 1]])
        back = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, size]]) / size
        return cls(middle, size, forth, back)


def gauss_newton_step(
    matrix: FloatArray, scaling: Scaling, mapped: FloatArray, residuals: FloatArray, weights: FloatArray
) -> FloatArray | None:
    """The homography after one weighted Gauss-Newton step, or None for degenerate points.

    Args:
        matrix: source to target.
        scaling: of the target points.
        mapped: the source points under `matrix`.
        residuals: the target points less `mapped`.
        weights: float64[n], 0 or more.
    """
    step = _step((mapped - scaling.middle) / scaling.size, residuals / scaling.size, weights)
    return None if step is None else normalised(scaling.forth @ step @ scaling.back @ matrix)


def corner_deviation(
    matrix: FloatArray, source: FloatArray, rmse: float, shape: tuple[int, int], freedom: int = 8
) -> float:
    """Standard deviation of a fitted motion at the worst corner of a frame.

    Args:
        matrix: source to target.
        source: the points it was fitted to.
        rmse: root mean square residual.
        shape: of the source frame.
        freedom: parameters of the motion, 8 for a homography, 6 for an affine one.

    Source: Hartley and Zisserman, Multiple View Geometry, section 5.2.
    """
    if 2 * len(source) <= freedom:
        return math.inf
    mapped = project(matrix, source)
    scaling = Scaling.of(mapped)
    powers = monomials((mapped - scaling.middle) / scaling.size)
    try:
        covariance = np.linalg.inv(_normal(powers @ powers.T)[:freedom, :freedom])
    except np.linalg.LinAlgError:
        return math.inf
    variance = rmse**2 * len(source) / (2 * len(source) - freedom)
    return worst_deviation(
        np.asarray(covariance, np.float64), scaling, project(matrix, corners(shape)), variance
    )


def worst_deviation(covariance: FloatArray, scaling: Scaling, points: FloatArray, variance: float) -> float:
    """Standard deviation of a motion at the worst of some points, px.

    Args:
        covariance: float64[f, f], inverse of the normal matrix of the first f parameters of a step.
        scaling: of the points that the motion was fitted to.
        points: float64[n, 2].
        variance: of one coordinate of a residual, px squared.
    """
    powers = monomials((points - scaling.middle) / scaling.size)
    slopes = np.concatenate([_ACROSS @ powers, _DOWN @ powers], axis=1)[: len(covariance)]
    # The variances of x and y add up.
    spread = (slopes * (covariance @ slopes)).sum(axis=0).reshape(2, -1).sum(axis=0)
    worst = float(spread.max()) * variance
    return math.sqrt(worst) if worst >= 0 else math.inf


def _step(points: FloatArray, residuals: FloatArray, weights: FloatArray) -> FloatArray | None:
    """The homography near the identity that moves the points by `residuals` best, to first order."""
    powers = monomials(points)
    counted = powers * weights
    sides = counted @ residuals
    wanted = np.concatenate([sides[3:, 0], sides[3:, 1], -sides[:2, 0] - sides[1:3, 1]])
    normal = _normal(counted @ powers.T)
    solved, step = cv2.solve(normal, wanted[:, np.newaxis], flags=cv2.DECOMP_CHOLESKY)
    if not solved:
        return None
    matrix = np.eye(3)
    matrix.ravel()[:8] += step[:, 0]
    return matrix


def monomials(points: FloatArray) -> FloatArray:
    """float64[6, n] of float64[n, 2]: x x, x y, y y, x, y, 1."""
    powers = np.empty((6, len(points)))
    powers[3:5] = points.T
    powers[5] = 1
    np.multiply(powers[3], powers[3:5], out=powers[:2])
    np.multiply(powers[4], powers[4], out=powers[2])
    return powers


def _normal(moments: FloatArray) -> FloatArray:
    """float64[8, 8], the normal matrix, from moments up to the fourth order, float64[6, 6]."""
    normal = np.zeros((8, 8))
    normal[:3, :3] = normal[3:6, 3:6] = moments[3:, 3:]
    normal[6:, :3] = -moments[:2, 3:]
    normal[6:, 3:6] = -moments[1:3, 3:]
    normal[:6, 6:] = normal[6:, :6].T
    normal[6:, 6:] = moments[:2, :2] + moments[1:3, 1:3]
    return normal
