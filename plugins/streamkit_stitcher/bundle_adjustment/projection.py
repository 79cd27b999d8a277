"""Projection of plane points into cameras, its derivatives, and the robust cost.

Observations are along the last axis, for vectorised passes over long rows.
"""

from dataclasses import dataclass

import numpy as np

from streamkit.geometry.homography import FloatArray


def projected(cameras: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Projects points by a homography each: points, and the third homogeneous coordinate, float64[k]."""
    x, y = points.T[:, :, np.newaxis]
    mapped = cameras[:, :, 0] * x + cameras[:, :, 1] * y + cameras[:, :, 2]
    return mapped[:, :2] / mapped[:, 2:], mapped[:, 2]


def robust_cost(residuals: FloatArray, huber: float) -> tuple[float, FloatArray | None]:
    """Half the sum of Huber's function of residuals float64[2, k], and their weights, None where all are 1.

    The cost grows linearly from a length of `huber` on.
    """
    squares = residuals[0] * residuals[0]
    squares += residuals[1] * residuals[1]
    if not squares.size or squares.max() <= huber * huber:
        return 0.5 * float(np.add.reduce(squares)), None
    lengths = np.sqrt(squares)
    weights = huber / np.maximum(lengths, huber)
    # The square up to `huber`; beyond, 2 huber |r| - huber^2.
    bounded = np.minimum(lengths, huber)
    return float((bounded * (lengths - 0.5 * bounded)).sum()), weights


@dataclass(frozen=True, eq=False)
class ProjectedObservations:
    """Projected observations, one per column.

    Attributes:
        elements: float64[3, 3, k], the homography of each observation's camera.
        points: float64[2, k], its point on the plane.
        projected: float64[2, k], the projection.
        depth: float64[k], the third homogeneous coordinate.
        residuals: float64[2, k], observed minus projected, times `root`.
        root: float64[k], square roots of the weights; None where all are 1.
        cost: half the sum of Huber's function of the residuals.
    """

    elements: FloatArray
    points: FloatArray
    projected: FloatArray
    depth: FloatArray
    residuals: FloatArray
    root: FloatArray | None
    cost: float

    @property
    def scale(self) -> FloatArray:
        """float64[k], factor of the derivatives of the homogeneous coordinates."""
        return (1.0 if self.root is None else self.root) / self.depth

    def slopes(self) -> FloatArray:
        """float64[2, 2, k], weighted derivatives of x and y by the point's x and y."""
        linear = self.elements[:2, :2] - self.projected[:, np.newaxis] * self.elements[2, :2]
        return np.asarray(linear * self.scale, dtype=np.float64)


def view(
    elements: FloatArray, points: FloatArray, observed: FloatArray, huber: float
) -> ProjectedObservations:
    """Projects points float64[2, k] by float64[3, 3, k], and compares them with float64[2, k] observed."""
    mapped = elements[:, 0] * points[0]
    mapped += elements[:, 1] * points[1]
    mapped += elements[:, 2]
    seen = mapped[:2] / mapped[2]
    residuals = observed - seen
    cost, weights = robust_cost(residuals, huber)
    if weights is None:
        return ProjectedObservations(elements, points, seen, mapped[2], residuals, None, cost)
    root = np.sqrt(weights)
    residuals *= root
    return ProjectedObservations(elements, points, seen, mapped[2], residuals, root, cost)
