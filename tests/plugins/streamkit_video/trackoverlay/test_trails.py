"""Tests of the trails."""

import numpy as np

from streamkit_video.trackoverlay.trails import MAX_POINTS, Trails

SHIFT = np.array([[1.0, 0.0, 5.0], [0.0, 1.0, -2.0], [0.0, 0.0, 1.0]])


def test_points_stay_on_the_ground() -> None:
    """When this frame's pixel x is the previous frame's x + 5, old points move by -5."""
    trails = Trails()
    trails.extend([1], [(20.0, 30.0)], 0)
    trails.warp(SHIFT)
    ((identity, points),) = trails.paths()
    assert identity == 1
    np.testing.assert_allclose(points, [[15.0, 32.0]])


def test_paths_are_in_order_of_time_by_id() -> None:
    """Each id has its own path, oldest first."""
    trails = Trails()
    trails.extend([2, 1], [(0.0, 0.0), (9.0, 9.0)], 0)
    trails.extend([1, 2], [(8.0, 8.0), (1.0, 1.0)], 1)
    paths = dict(trails.paths())
    np.testing.assert_array_equal(paths[1], [[9.0, 9.0], [8.0, 8.0]])
    np.testing.assert_array_equal(paths[2], [[0.0, 0.0], [1.0, 1.0]])


def test_old_points_are_forgotten() -> None:
    """Only points younger than the limit stay."""
    trails = Trails()
    for time_ns in range(10):
        trails.extend([1], [(float(time_ns), 0.0)], time_ns)
    trails.drop_before(time_ns=7)
    ((_, points),) = trails.paths()
    np.testing.assert_array_equal(points[:, 0], [7.0, 8.0, 9.0])


def test_the_store_is_bounded() -> None:
    """However many targets, no more than the bound is kept, and the newest stay."""
    trails = Trails()
    ids = list(range(3000))
    for time_ns in range(12):
        trails.extend(ids, [(float(time_ns), 0.0)] * 3000, time_ns)
        trails.drop_before(time_ns=0)
    assert len(trails) == MAX_POINTS
    assert max(points[-1, 0] for _, points in trails.paths()) == 11.0


def test_a_singular_homography_clears() -> None:
    """Where the ground cannot be followed nothing is known."""
    for broken in (np.zeros((3, 3)), np.full((3, 3), np.nan)):
        trails = Trails()
        trails.extend([1], [(1.0, 2.0)], 0)
        trails.warp(broken)
        assert len(trails) == 0
