"""Windows under homographies."""

import numpy as np

from streamkit_tracker.window_geometry import (
    half_turn,
    is_inside,
    map_points,
    visible_fraction,
)


def test_jacobian_is_the_derivative_of_the_map():
    """The Jacobian of a homography agrees with finite differences."""
    homography = np.array([[1.1, 0.1, 5.0], [-0.05, 0.9, 3.0], [1e-4, -2e-4, 1.0]])
    point = np.array([[120.0, 80.0]])
    _, jacobians = map_points(homography, point)
    step = 1e-4
    for axis in range(2):
        moved = point.copy()
        moved[0, axis] += step
        difference = (map_points(homography, moved)[0] - map_points(homography, point)[0])[0] / step
        np.testing.assert_allclose(jacobians[0][:, axis], difference, atol=1e-5)


def test_point_at_infinity_stays():
    """A point that the homography sends to infinity stays where it was, so that no NaN arises."""
    homography = np.array([[1.0, 0, 0], [0, 1.0, 0], [0.01, 0, 1.0]])
    mapped, _ = map_points(homography, np.array([[-100.0, 5.0]]))
    np.testing.assert_array_equal(mapped, [[-100.0, 5.0]])


def test_angles_wrap_modulo_pi():
    """A direction has no sign: angles pi apart are the same."""
    np.testing.assert_allclose([half_turn(0.2 + turn) for turn in (0.0, np.pi, -np.pi)], 0.2, atol=1e-12)


def test_visible_fraction_counts_what_lies_in_the_frame():
    """Inside is 1, outside is 0, half over the left border is one half."""
    windows = np.array([[50.0, 50, 20, 20, 0], [-50, 50, 20, 20, 0], [-0.5, 50, 20, 20, 0]])
    np.testing.assert_allclose(visible_fraction(windows, (100, 100)), [1.0, 0.0, 0.5])


def test_inside_follows_the_turned_rectangle():
    """A point near the long axis is inside, the same distance across is not."""
    window = np.array([0.0, 0.0, 40.0, 10.0, np.pi / 2])
    assert [is_inside(*point, window, 1.0) for point in ((0.0, 15.0), (15.0, 0.0))] == [True, False]
