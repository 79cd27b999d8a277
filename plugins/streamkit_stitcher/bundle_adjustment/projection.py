"""Where cameras see plane points, how that changes with either, and what an error costs."""

from dataclasses import dataclass

import numpy as np

from streamkit_stitcher.bundle_adjustment.problem import IndexArray
from streamkit_stitcher.homographies import FloatArray


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals and their derivatives, each times the square root of its weight.

    Attributes:
        residuals: float64[k, 2], observed minus projected.
        camera: float64[k, 2, c], derivatives of the projection by the camera's free parameters.
        point: float64[k, 2, 2], derivatives by the point.
    """

    residuals: FloatArray
    camera: FloatArray
    point: FloatArray


def projected(cameras: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Projects each point through its own homography.

    Args:
        cameras: float64[k, 3, 3].
        points: float64[k, 2].

    Returns:
        float64[k, 2] and the third homogeneous coordinate, float64[k].
    """
    mapped = (cameras[:, :, :2] @ points[:, :, np.newaxis])[:, :, 0] + cameras[:, :, 2]
    depth = mapped[:, 2]
    return mapped[:, :2] / depth[:, np.newaxis], depth


def robust_cost(residuals: FloatArray, huber: float) -> tuple[float, FloatArray]:
    """Half the sum of Huber's function of the residuals' lengths, and the weight of each.

    Args:
        residuals: float64[k, 2].
        huber: length from which the cost grows linearly.

    Returns:
        The cost and float64[k] weights, 1 up to `huber` and falling beyond.
    """
    lengths = np.sqrt(np.einsum("ki,ki->k", residuals, residuals))
    beyond = lengths > huber
    squared = np.where(beyond, 2 * huber * lengths - huber**2, lengths**2) if beyond.any() else lengths**2
    weights = np.divide(huber, lengths, out=np.ones_like(lengths), where=beyond)
    return 0.5 * float(squared.sum()), weights


def linearise(
    cameras: FloatArray,
    points: FloatArray,
    index: tuple[IndexArray, IndexArray],
    observed: FloatArray,
    basis: FloatArray,
    huber: float,
) -> Linearised:
    """Residuals and Jacobians at the present estimate.

    Args:
        cameras: float64[n, 3, 3].
        points: float64[m, 2].
        index: camera and point of each observation.
        observed: float64[k, 2].
        basis: float64[8, c], from free parameters to matrix elements.
        huber: see `robust_cost`.
    """
    own, place = cameras[index[0]], points[index[1]]
    seen, depth = projected(own, place)
    residuals = observed - seen
    root = np.sqrt(robust_cost(residuals, huber)[1])
    scale = root / depth
    camera = np.zeros((len(observed), 2, 8))
    camera[:, 0, :2] = camera[:, 1, 3:5] = place * scale[:, np.newaxis]
    camera[:, 0, 2] = camera[:, 1, 5] = scale
    camera[:, :, 6:] = -seen[:, :, np.newaxis] * camera[:, :1, :2]
    if basis.shape[1] != 8:
        camera = camera @ basis
    return Linearised(residuals * root[:, np.newaxis], camera, _slopes(own, seen, scale))


def point_slopes(
    cameras: FloatArray,
    points: FloatArray,
    index: tuple[IndexArray, IndexArray],
    observed: FloatArray,
    huber: float,
) -> tuple[FloatArray, FloatArray]:
    """The residuals and point derivatives of `linearise` alone."""
    own = cameras[index[0]]
    seen, depth = projected(own, points[index[1]])
    residuals = observed - seen
    root = np.sqrt(robust_cost(residuals, huber)[1])
    return residuals * root[:, np.newaxis], _slopes(own, seen, root / depth)


def _slopes(own: FloatArray, seen: FloatArray, scale: FloatArray) -> FloatArray:
    slopes = (own[:, :2, :2] - seen[:, :, np.newaxis] * own[:, 2:, :2]) * scale[:, np.newaxis, np.newaxis]
    return np.asarray(slopes, dtype=np.float64)
