"""Merging of fragments."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.clusters import clustered, merge_by_scatter
from streamkit_differencer.settings import Criterion


def as_partition(cluster):
    """The clusters as sets of fragments."""
    return {frozenset(np.flatnonzero(cluster == number).tolist()) for number in set(cluster.tolist())}


def partition_by_gap(labels, gap):
    """The sets of fragments that get one label."""
    clusters, _ = clustered(np.where(labels > 0, 255, 0).astype(np.uint8), Criterion.GAP, gap)
    of_fragment = [set(clusters[labels == number].tolist()) for number in range(1, labels.max() + 1)]
    assert all(len(found) == 1 for found in of_fragment)
    return as_partition(np.array([found.pop() for found in of_fragment]))


def nearest_pair_by_hand(labels, gap):
    """Merges the nearest pair again and again, as the paper words it."""
    cells = [np.argwhere(labels == number) for number in range(1, labels.max() + 1)]
    clusters = [({index}, members) for index, members in enumerate(cells)]

    def distance(first, second):
        return np.abs(first[:, None] - second[None]).max(axis=2).min() - 1

    while len(clusters) > 1:
        pairs = [(i, j) for i in range(len(clusters)) for j in range(i)]
        i, j = min(pairs, key=lambda pair: distance(clusters[pair[0]][1], clusters[pair[1]][1]))
        if distance(clusters[i][1], clusters[j][1]) >= gap:
            break
        merged = clusters[i][0] | clusters[j][0], np.concatenate([clusters[i][1], clusters[j][1]])
        clusters = [item for k, item in enumerate(clusters) if k not in (i, j)] + [merged]
    return {frozenset(members) for members, _ in clusters}


def labelled(*boxes, shape=(30, 40)):
    """Fragments that are boxes x0 y0 x1 y1, the last exclusive."""
    labels = np.zeros(shape, np.int32)
    for number, (left, top, right, bottom) in enumerate(boxes, 1):
        labels[top:bottom, left:right] = number
    return labels


@pytest.mark.parametrize("seed", range(10))
def test_gap_merging_equals_merging_the_nearest_pair(seed):
    """What is found at once is what merging the nearest pair again and again gives."""
    random = np.random.default_rng(seed)
    _, labels = cv2.connectedComponents((random.random((30, 40)) < 0.03).astype(np.uint8))
    gap = int(random.integers(0, 5))
    assert partition_by_gap(labels, gap) == nearest_pair_by_hand(labels, gap)


def test_gap_counts_empty_cells_between_fragments():
    """Fragments with two empty cells between them merge at gap 3 and not at gap 2."""
    labels = labelled((0, 0, 4, 4), (6, 1, 9, 3))
    assert len(partition_by_gap(labels, 3)) == 1
    assert len(partition_by_gap(labels, 2)) == 2


def test_things_side_by_side_stay_apart():
    """Two that merge do not take in a third that lies in the corner of the box around both."""
    labels = labelled((2, 2, 6, 4), (7, 4, 11, 6), (2, 10, 6, 12), (9, 13, 13, 15))
    labels[4:13, 12], labels[13:15, 12] = 2, 4
    labels[labels == 4] = 2
    assert partition_by_gap(labels, 2) == {frozenset({0, 1}), frozenset({2})}


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
    assert partition_by_gap(labelled((0, 0, 2, 2)), 3) == {frozenset({0})}
    assert merge_by_scatter(np.array([[1.0, 1.0]]), np.array([4.0]), 3).tolist() == [0]
