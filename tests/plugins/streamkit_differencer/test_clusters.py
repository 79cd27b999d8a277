"""Merging of fragments."""

import numpy as np
import pytest

from streamkit_differencer.clusters import merge_by_gap, merge_by_scatter


def as_partition(cluster):
    """The clusters as sets of fragments."""
    return {frozenset(np.flatnonzero(cluster == number).tolist()) for number in set(cluster.tolist())}


def nearest_pair_by_hand(boxes, gap):
    """Merges the nearest pair again and again, as the paper words it."""
    clusters = [({index}, tuple(box)) for index, box in enumerate(boxes)]

    def distance(first, second):
        return max(first[0] - second[2], second[0] - first[2], first[1] - second[3], second[1] - first[3])

    while len(clusters) > 1:
        pairs = [(i, j) for i in range(len(clusters)) for j in range(i)]
        i, j = min(pairs, key=lambda pair: distance(clusters[pair[0]][1], clusters[pair[1]][1]))
        if distance(clusters[i][1], clusters[j][1]) >= gap:
            break
        (a, p), (b, q) = clusters[i], clusters[j]
        merged = (min(p[0], q[0]), min(p[1], q[1]), max(p[2], q[2]), max(p[3], q[3]))
        clusters = [item for k, item in enumerate(clusters) if k not in (i, j)] + [(a | b, merged)]
    return {frozenset(members) for members, _ in clusters}


@pytest.mark.parametrize("seed", range(20))
def test_gap_merging_equals_merging_the_nearest_pair(seed):
    """Merging all near pairs of a round at once gives what merging the nearest pair first gives."""
    random = np.random.default_rng(seed)
    low = random.integers(0, 60, (25, 2)).astype(float)
    boxes = np.hstack([low, low + random.integers(1, 6, (25, 2))])
    gap = float(random.integers(0, 5))
    assert as_partition(merge_by_gap(boxes, gap)) == nearest_pair_by_hand(boxes, gap)


def test_gap_counts_empty_cells_between_boxes():
    """Boxes with two empty cells between them merge at gap 3 and not at gap 2."""
    boxes = np.array([[0, 0, 4, 4], [6, 1, 9, 3]], float)
    assert len(as_partition(merge_by_gap(boxes, 3))) == 1
    assert len(as_partition(merge_by_gap(boxes, 2))) == 2


def criterion(cluster, centres, areas, gap):
    """J of a clustering."""
    total = 2.0 * gap**4 * len(set(cluster.tolist()))
    for number in set(cluster.tolist()):
        members = cluster == number
        mean = np.average(centres[members], axis=0, weights=areas[members])
        total += float((areas[members] * np.square(centres[members] - mean).sum(axis=1)).sum())
    return total


@pytest.mark.parametrize("seed", range(10))
def test_scatter_merging_stops_where_no_merge_lowers_the_criterion(seed):
    """J is not above that of the fragments, and merging any two clusters more would raise it."""
    random = np.random.default_rng(seed)
    centres, areas = random.uniform(0, 40, (20, 2)), random.integers(1, 30, 20).astype(float)
    cluster = merge_by_scatter(centres, areas, 3.0)
    lowest = criterion(cluster, centres, areas, 3.0)
    assert lowest <= criterion(np.arange(20), centres, areas, 3.0)
    numbers = sorted(set(cluster.tolist()))
    for first in numbers:
        for second in numbers:
            if first < second:
                merged = np.where(cluster == second, first, cluster)
                assert criterion(merged, centres, areas, 3.0) >= lowest - 1e-6


def test_one_fragment_is_one_cluster():
    """Nothing to merge is no error."""
    assert merge_by_gap(np.array([[0, 0, 2, 2]], float), 3).tolist() == [0]
    assert merge_by_scatter(np.array([[1.0, 1.0]]), np.array([4.0]), 3).tolist() == [0]
