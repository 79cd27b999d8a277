"""How well detections fit targets, and which belongs to which."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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

    Source: Crouse, On implementing 2D rectangular assignment algorithms, IEEE Transactions on Aerospace and
    Electronic Systems 52, 2016. scipy's is the same, but takes most of a second to import.
    """
    if costs.size == 0 or not allowed.any():
        return []
    # nothing may overflow on the way: the search ends because some column is always nearest
    finite = np.where(allowed, np.fmin(costs, FORBIDDEN), FORBIDDEN)
    wide = len(costs) <= costs.shape[1]
    partners = np.full(min(costs.shape), -1, np.int64)
    _match(np.ascontiguousarray(finite if wide else finite.T), partners)
    chosen = enumerate(partners.tolist())
    pairs = list(chosen) if wide else sorted((row, column) for column, row in chosen)
    return [pair for pair in pairs if allowed[pair]]


@compiled
def _shortest_path(
    costs: FloatArray,
    start: int,
    row_prices: FloatArray,
    column_prices: FloatArray,
    holders: CountArray,
    before: CountArray,
    shortest: FloatArray,
    settled: NDArray[np.bool_],
) -> tuple[int, float]:
    """From a row without a column to a column that is nobody's, and the length: Dijkstra's algorithm.

    `before`, int64[m], `shortest`, float64[m], and `settled`, bool[m], are filled: the row through which each
    column is reached, how far it is, and whether that is final.
    """
    shortest[:], settled[:] = np.inf, False
    row, length = start, 0.0
    while True:
        nearest, least = -1, np.inf
        line, further = costs[row], length - row_prices[row]
        for column in range(len(holders)):
            if settled[column]:
                continue
            way = further + line[column] - column_prices[column]
            if way < shortest[column]:
                shortest[column], before[column] = way, row
            if shortest[column] < least:
                nearest, least = column, shortest[column]
        length, settled[nearest] = least, True
        if holders[nearest] < 0:
            return nearest, length
        row = holders[nearest]


@compiled
def _match(costs: FloatArray, partners: CountArray) -> None:
    """Finds every row's column, int64[n], at the least total of costs float64[n, m], n not above m."""
    rows, columns = costs.shape
    row_prices, column_prices = np.zeros(rows), np.zeros(columns)
    holders, before = np.full(columns, -1, np.int64), np.empty(columns, np.int64)
    shortest, settled = np.empty(columns), np.empty(columns, np.bool_)
    for start in range(rows):
        end, length = _shortest_path(
            costs, start, row_prices, column_prices, holders, before, shortest, settled
        )
        row_prices[start] += length
        for column in range(columns):
            if settled[column]:
                column_prices[column] -= length - shortest[column]
                if column != end:
                    row_prices[holders[column]] += length - shortest[column]
        # everybody on the path hands a column on to the row before
        row, column = -1, end
        while row != start:
            row = before[column]
            holders[column] = row
            partners[row], column = column, partners[row]


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
