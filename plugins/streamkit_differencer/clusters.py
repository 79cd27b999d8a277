"""Merging of fragments into objects "under the guidance of the criterion function J_mn".

The paper leaves J_mn undefined. Two readings make sense, and both stop where the criterion is smallest.
"""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.intp]


class Criterion(enum.StrEnum):
    """What J_mn is: the gap between two fragments' boxes, or the scatter that merging them adds."""

    GAP = "gap"
    SCATTER = "scatter"


def merge_by_gap(corners: FloatArray, gap: float) -> IntArray:
    """Merges the nearest pair of boxes until no two are less than `gap` apart.

    A merged box is never farther from a third than its parts were, so the order of merging does not matter
    and all near pairs of a round are merged at once.

    Args:
        corners: float64[n, 4], x0 y0 x1 y1, the last exclusive.
        gap: smallest distance between two clusters' boxes, along the axis on which they are farther apart.

    Returns:
        int[n], the number of each fragment's cluster, from 0.
    """
    cluster = np.arange(len(corners))
    boxes = corners
    while len(boxes) > 1:
        left, top, right, bottom = boxes.T
        apart = np.maximum(left[:, None] - right, top[:, None] - bottom)
        apart = np.maximum(apart, apart.T)
        roots = np.argmax(apart < gap, axis=1)
        if (roots == np.arange(len(boxes))).all():
            break
        names, renumbered = np.unique(roots, return_inverse=True)
        merged = np.empty((len(names), 4))
        merged[:, :2], merged[:, 2:] = np.inf, -np.inf
        np.minimum.at(merged[:, :2], renumbered, boxes[:, :2])
        np.maximum.at(merged[:, 2:], renumbered, boxes[:, 2:])
        cluster, boxes = renumbered[cluster], merged
    return cluster


def merge_by_scatter(centres: FloatArray, areas: FloatArray, gap: float) -> IntArray:
    """Merges while the sum of the scatter within clusters and a price per cluster falls.

    J = sum of squared distances of the cells from their cluster's centre + price * number of clusters.
    Merging m and n changes it by n_m n_n / (n_m + n_n) |c_m - c_n|^2 - price; the pair that lowers it most is
    merged until none does. The price is what two squares of `gap` by `gap` cells, `gap` apart, cost.

    Args:
        centres: float64[n, 2], centres of the fragments, cells.
        areas: float64[n], cells.
        gap: sets the price, cells.

    Returns:
        int[n], the number of each fragment's cluster, from 0.

    Source: Ward, "Hierarchical Grouping to Optimize an Objective Function", 1963; the price per cluster as in
        Kulis and Jordan, "Revisiting k-means", 2012.
    """
    price = 2.0 * gap**4
    count = len(areas)
    cluster = np.arange(count)
    centre, weight = centres.astype(np.float64).copy(), areas.astype(np.float64).copy()
    distance = np.square(centre[:, None] - centre[None]).sum(axis=2)
    cost = weight[:, None] * weight[None] / (weight[:, None] + weight[None]) * distance
    np.fill_diagonal(cost, np.inf)
    while count > 1:
        first, second = divmod(int(np.argmin(cost)), count)
        if cost[first, second] >= price:
            break
        total = weight[first] + weight[second]
        centre[first] = (weight[first] * centre[first] + weight[second] * centre[second]) / total
        weight[first] = total
        cluster[cluster == second] = first
        cost[second], cost[:, second] = np.inf, np.inf
        alive = np.isfinite(cost).any(axis=0)
        alive[first] = False
        moved = np.square(centre - centre[first]).sum(axis=1)
        row = np.where(alive, weight * total / (weight + total) * moved, np.inf)
        cost[first], cost[:, first] = row, row
    return np.unique(cluster, return_inverse=True)[1]
