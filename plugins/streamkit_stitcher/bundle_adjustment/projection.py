"""Where cameras see plane points, how that changes with either, and what an error costs.

Inside an adjustment the observations lie along the last axis, so that each step is one pass over long rows.
"""

from dataclasses import dataclass

import numpy as np

from streamkit.geometry.homography import FloatArray


def projected(cameras: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Projects each point through its own homography.

    Args:
        cameras: float64[k, 3, 3].
        points: float64[k, 2].

    Returns:
        float64[k, 2] and the third homogeneous coordinate, float64[k].
    """
    x, y = points.T[:, :, np.newaxis]
    mapped = cameras[:, :, 0] * x + cameras[:, :, 1] * y + cameras[:, :, 2]
    return mapped[:, :2] / mapped[:, 2:], mapped[:, 2]


def robust_cost(residuals: FloatArray, huber: float) -> tuple[float, FloatArray | None]:
    """Half the sum of Huber's function of the residuals' lengths, and the weight of each.

    Args:
        residuals: float64[2, k].
        huber: length from which the cost grows linearly.

    Returns:
        The cost and float64[k] weights, 1 up to `huber` and falling beyond; None where all are 1.
    """
    squares = residuals[0] * residuals[0]
    squares += residuals[1] * residuals[1]
    if not squares.size or squares.max() <= huber * huber:
        return 0.5 * float(np.add.reduce(squares)), None
    lengths = np.sqrt(squares)
    weights = huber / np.maximum(lengths, huber)
    # Up to the bound the weight is 1 and this is the square; beyond, 2 huber |r| - huber^2.
    bounded = np.minimum(lengths, huber)
    return float((bounded * (lengths - 0.5 * bounded)).sum()), weights


@dataclass(frozen=True, eq=False)
class Views:
    """What the cameras see of the points: one column per observation.

    Attributes:
        elements: float64[3, 3, k], the homography of each observation's camera.
        places: float64[2, k], its point on the plane.
        seen: float64[2, k], where the camera sees that.
        depth: float64[k], the third homogeneous coordinate.
        residuals: float64[2, k], observed minus seen, times `root` where there is one.
        root: float64[k], square roots of the weights; None where all are 1.
        cost: half the sum of Huber's function of the residuals.
    """

    elements: FloatArray
    places: FloatArray
    seen: FloatArray
    depth: FloatArray
    residuals: FloatArray
    root: FloatArray | None
    cost: float

    @property
    def scale(self) -> FloatArray:
        """float64[k], what the derivatives of the homogeneous coordinates are multiplied with."""
        return (1.0 if self.root is None else self.root) / self.depth

    def slopes(self) -> FloatArray:
        """float64[2, 2, k], weighted derivatives of x and y by the point's x and y."""
        linear = self.elements[:2, :2] - self.seen[:, np.newaxis] * self.elements[2, :2]
        return np.asarray(linear * self.scale, dtype=np.float64)


def view(elements: FloatArray, places: FloatArray, observed: FloatArray, huber: float) -> Views:
    """Projects points and compares them with what was observed.

    Args:
        elements: float64[3, 3, k].
        places: float64[2, k].
        observed: float64[2, k].
        huber: see `robust_cost`.
    """
    mapped = elements[:, 0] * places[0]
    mapped += elements[:, 1] * places[1]
    mapped += elements[:, 2]
    seen = mapped[:2] / mapped[2]
    residuals = observed - seen
    cost, weights = robust_cost(residuals, huber)
    if weights is None:
        return Views(elements, places, seen, mapped[2], residuals, None, cost)
    root = np.sqrt(weights)
    residuals *= root
    return Views(elements, places, seen, mapped[2], residuals, root, cost)
