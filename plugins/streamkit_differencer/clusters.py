"""Merging of fragments into objects "under the guidance of the criterion function J_mn".

The paper leaves J_mn undefined. Two readings make sense; both stop where the criterion is smallest.
"""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_differencer.arrays import ByteImage, FloatArray, LabelImage
from streamkit_differencer.settings import Criterion

# Merging by scatter is quadratic: more fragments than this are noise.
MAX_FRAGMENTS = 1500


def clustered(cells: ByteImage, criterion: Criterion, gap: int) -> tuple[LabelImage, int]:
    """The object of each cell, int32[h, w] from 1, undefined between cells; and the number of objects.

    By gap, the two nearest clusters are merged until no two have less than `gap` cells between them. Their
    distance is that of their nearest cells. The distance of their boxes would merge vehicles that drive side
    by side: the box around two of them overlaps a third.

    Args:
        cells: uint8[h, w], mask.
        criterion: J_mn; that of the gap also where there are too many fragments for the other.
        gap: empty cells between two clusters that stay apart; for scatter see `merge_by_scatter`.

    Source: merging the nearest pair up to a distance is single linkage; its result is the connected
        components of all cells within that distance.
    """
    if criterion is Criterion.SCATTER:
        count, labels, statistics, centres = cv2.connectedComponentsWithStats(cells, connectivity=8)
        if count <= MAX_FRAGMENTS:
            areas = statistics[1:, cv2.CC_STAT_AREA].astype(np.float64)
            cluster = merge_by_scatter(centres[1:].astype(np.float64), areas, gap)
            numbers = np.concatenate([[0], cluster + 1]).astype(np.int32)
            return numbers[labels], int(cluster.max()) + 1
    # Dilated by this, cells with less than `gap` between them touch.
    near = cv2.dilate(cells, np.ones((gap, gap), np.uint8)) if gap > 1 else cells
    count, labels = cv2.connectedComponents(near, connectivity=8)
    return cast("LabelImage", labels), count - 1


def merge_by_scatter(centres: FloatArray, areas: FloatArray, gap: int) -> NDArray[np.intp]:
    """Merges while the sum of the scatter within clusters and a penalty per cluster falls.

    J = sum of squared distances of the cells from their cluster's centre + penalty * number of clusters.
    Merging m and n changes it by n_m n_n / (n_m + n_n) |c_m - c_n|^2 - penalty; the pair that lowers it most
    is merged until none does. The penalty is the scatter of two squares of `gap` by `gap` cells, `gap` apart.

    Args:
        centres: float64[n, 2], centres of the fragments, cells.
        areas: float64[n], cells.
        gap: sets the penalty, cells.

    Returns:
        int[n], the number of each fragment's cluster, from 0.

    Source: Ward, "Hierarchical Grouping to Optimize an Objective Function", 1963; the penalty per cluster as
        in Kulis and Jordan, "Revisiting k-means", 2012.
    """
    penalty = 2.0 * gap**4
    count = len(areas)
    cluster = np.arange(count)
    centre, weight = centres.astype(np.float64).copy(), areas.astype(np.float64).copy()
    distance = np.square(centre[:, None] - centre[None]).sum(axis=2)
    cost = weight[:, None] * weight[None] / (weight[:, None] + weight[None]) * distance
    np.fill_diagonal(cost, np.inf)
    while count > 1:
        first, second = divmod(int(np.argmin(cost)), count)
        if cost[first, second] >= penalty:
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
