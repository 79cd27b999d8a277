"""How well detections fit targets, and which belongs to which."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import FloatArray

CountArray = NDArray[np.int64]

FORBIDDEN = 1e6
GATE = 16.0
LEAST_UPON, LAST_CHOICE = 0.15, 100.0
SMALLEST_SIZE = 4.0
TOUCHING = 0.05
X, Y, XX, XY, YY, WIDTH, HEIGHT, STD, REACH = range(9)
LEFT, TOP, RIGHT, BOTTOM = range(2, 6)


@dataclass(frozen=True, eq=False)
class Comparison:
    """How t targets and d detections lie to each other.

    Attributes:
        costs: float64[t, d], infinite for pairs that are not allowed.
        distances: float64[t, d], squared, of the centroids from the targets, standard deviations.
        mismatch: float64[t, d], how far the boxes miss the targets' sizes, px.
        held: int64[d], targets with their centre in the box.
        touched: int64[d], targets with a part of themselves in the box.
    """

    costs: FloatArray
    distances: FloatArray
    mismatch: FloatArray
    held: CountArray
    touched: CountArray


def compare(expected: FloatArray, detected: FloatArray, unlike: FloatArray) -> Comparison:
    """Compares every target with every detection.

    A pair is allowed within the gate and within reach; and, as a last choice, where the boxes overlap: a
    covariance that is too small must not make a second target of what lies upon the first.

    Args:
        expected: float64[t, 9], for each target x, y (px), their covariance xx, xy, yy, the box's width and
            height, the standard deviation of its detections' centroids, and how far it can have come, px.
        detected: float64[d, 6], for each detection the centroid's x, y and its box x0 y0 x1 y1, px.
        unlike: float64[t, d], what the costs are to be raised by.
    """
    shape = (len(expected), len(detected))
    found = Comparison(
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
        np.zeros(len(detected), np.int64),
        np.zeros(len(detected), np.int64),
    )
    _compare(
        expected, detected, unlike, found.costs, found.distances, found.mismatch, found.held, found.touched
    )
    return found


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
    chosen = allowed[rows, columns]
    return list(zip(rows[chosen].tolist(), columns[chosen].tolist(), strict=True))


@compiled
def _compare(
    expected: FloatArray,
    detected: FloatArray,
    unlike: FloatArray,
    costs: FloatArray,
    distances: FloatArray,
    mismatch: FloatArray,
    held: CountArray,
    touched: CountArray,
) -> None:
    """Fills in a `Comparison`, whose counts are 0 before."""
    for row in range(len(expected)):
        target = expected[row]
        for column in range(len(detected)):
            seen = detected[column]
            distance = _distance(target, seen)
            missed = max(
                abs(seen[RIGHT] - seen[LEFT] - target[WIDTH]), abs(seen[BOTTOM] - seen[TOP] - target[HEIGHT])
            )
            upon, held_here, touched_here = _overlap(target, seen)
            apart = np.hypot(seen[X] - target[X], seen[Y] - target[Y])
            size = max(target[WIDTH], target[HEIGHT], SMALLEST_SIZE)
            cost = distance + (missed / size) ** 2 + unlike[row, column]
            if distance > GATE or apart > target[REACH] + 4 * target[STD]:
                cost = LAST_CHOICE + GATE * (1.0 - upon) if upon > LEAST_UPON else np.inf
            costs[row, column], distances[row, column], mismatch[row, column] = cost, distance, missed
            held[column] += held_here
            touched[column] += touched_here


@compiled
def _distance(target: FloatArray, seen: FloatArray) -> float:
    """Squared distance of a centroid from where a target is expected, in standard deviations."""
    variance = target[STD] ** 2
    xx, yy, xy = target[XX] + variance, target[YY] + variance, target[XY]
    across, down = seen[X] - target[X], seen[Y] - target[Y]
    determinant = max(xx * yy - xy**2, 1e-12)
    return float((yy * across**2 - 2 * xy * across * down + xx * down**2) / determinant)


@compiled
def _overlap(target: FloatArray, seen: FloatArray) -> tuple[float, bool, bool]:
    """Intersection over union of the boxes; whether the detection's holds, and touches, the target."""
    half_width, half_height = target[WIDTH] / 2, target[HEIGHT] / 2
    across = min(target[X] + half_width, seen[RIGHT]) - max(target[X] - half_width, seen[LEFT])
    down = min(target[Y] + half_height, seen[BOTTOM]) - max(target[Y] - half_height, seen[TOP])
    common = max(across, 0.0) * max(down, 0.0)
    area = (seen[RIGHT] - seen[LEFT]) * (seen[BOTTOM] - seen[TOP])
    size = target[WIDTH] * target[HEIGHT]
    holds = seen[LEFT] <= target[X] <= seen[RIGHT] and seen[TOP] <= target[Y] <= seen[BOTTOM]
    touches = holds or common > TOUCHING * min(area, size)
    return common / (size + area - common), holds, touches
