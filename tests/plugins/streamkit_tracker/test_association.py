"""Gated assignment."""

import numpy as np

from streamkit_tracker.association import assign, mahalanobis_squared


def test_the_total_cost_counts_not_the_nearest():
    """Two targets claim one detection: the pairing with the least total cost wins."""
    costs = np.array([[1.0, 2.0], [1.5, 9.0]])
    assert assign(costs, np.ones((2, 2), bool)) == [(0, 1), (1, 0)]


def test_pairs_outside_the_gate_stay_apart():
    """What is not allowed is not paired, even when nothing else is left."""
    allowed = np.array([[True, False], [False, False]])
    assert assign(np.where(allowed, 1.0, np.inf), allowed) == [(0, 0)]
    assert assign(np.zeros((0, 3)), np.zeros((0, 3), bool)) == []


def test_distance_is_in_standard_deviations():
    """A 3 px offset along an axis of variance 8 + 1 is one standard deviation."""
    distances = mahalanobis_squared(
        np.zeros((1, 2)), np.diag([8.0, 3.0])[None], np.array([[3.0, 0.0], [0.0, 4.0]]), np.ones((1, 2))
    )
    np.testing.assert_allclose(distances, [[1.0, 4.0]])
