"""Merging of fragments into objects "under the guidance of the criterion function J_mn".

The paper leaves J_mn undefined. Two readings make sense, and both stop where the criterion is smallest.
"""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    ByteImage = NDArray[np.uint8]
    IntArray = NDArray[np.intp]
    LabelImage = NDArray[np.int32]


class Criterion(enum.StrEnum):
    """What J_mn is: the gap between two fragments, or the scatter that merging them adds."""

    GAP = "gap"
    SCATTER = "scatter"


def label_by_gap(cells: ByteImage, gap: int) -> tuple[LabelImage, int]:
    """Merges the two nearest clusters until no two have less than `gap` cells between them.

    The distance is that of the nearest cells. Between the clusters' boxes it would grow together what drives
    side by side: the box around two cars takes in a third that touches neither.

    Args:
        cells: uint8[h, w], 255 where there is something.
        gap: empty cells that two clusters must have between them to stay apart.

    Returns:
        int32[h, w], the cluster that each cell belongs to, from 1; what it is between cells means nothing.
        And how many clusters there are.

    Source: merging the nearest pair up to a distance is single linkage, and what it leaves are the connected
        components of everything that lies that near.
    """
    # Grown by this, cells with less than `gap` between them touch.
    near = cv2.dilate(cells, np.ones((gap, gap), np.uint8)) if gap > 1 else cells
    count, labels = cv2.connectedComponents(near, connectivity=8)
    return cast("LabelImage", labels), count - 1


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
