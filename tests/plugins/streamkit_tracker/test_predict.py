"""The constant-velocity filter."""

import numpy as np

from streamkit_tracker.predict import advance, correct, predict
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import TargetTable


def table(window: tuple[float, float, float, float, float] = (0.0, 0.0, 10.0, 10.0, 0.0)) -> TargetTable:
    """One target drawn by hand, 10 px wide: accelerations of 20 px/s^2."""
    targets = TargetTable(TrackerSettings())
    targets.add(np.array([window]), drawn=True, cause="")
    return targets


def follow(steps: list[float], noise: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance after following a steady mover."""
    generator = np.random.default_rng(0)
    rows = table().rows
    rows["covariance"] = np.diag([1.0, 1.0, 1e4, 1e4])
    rows["measured"], rows["noise"] = True, noise**2 * np.eye(2)
    time = 0.0
    for step in steps:
        time += step
        advance(rows, step)
        rows["measurement"] = np.array([60.0, -25.0]) * time + noise * generator.standard_normal(2)
        correct(rows)
    return rows["mean"][0], rows["covariance"][0]


def test_velocity_is_per_second_whatever_the_steps():
    """Uneven times between frames give the same px/s."""
    even, _ = follow([0.04] * 50)
    uneven, _ = follow([0.02, 0.1, 0.04, 0.08] * 12)
    for mean in (even, uneven):
        np.testing.assert_allclose(mean[2:], [60.0, -25.0], atol=6.0)


def test_covariance_stays_symmetric_and_positive():
    """Joseph's form keeps the covariance a covariance."""
    _, covariance = follow([0.04] * 200)
    np.testing.assert_allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_carry_turns_velocity_with_the_camera():
    """A camera that turned by 90 degrees turns position and velocity alike."""
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    targets = table()
    targets.rows["mean"], targets.rows["covariance"] = [2.0, 1.0, 5.0, 0.0], np.eye(4)
    predict(targets, np.linalg.inv(quarter), 0.0)
    np.testing.assert_allclose(targets.rows["mean"][0], [-1.0, 2.0, 0.0, 5.0], atol=1e-12)


SIMILARITY = np.array(
    [
        [1.5 * np.cos(0.5), -1.5 * np.sin(0.5), 7.0],
        [1.5 * np.sin(0.5), 1.5 * np.cos(0.5), -3.0],
        [0, 0, 1.0],
    ]
)


def test_similarity_moves_turns_and_scales_a_detected_window():
    """A similarity moves the centre, adds its angle and multiplies both sides by its scale."""
    targets = table((30.0, 40.0, 20.0, 10.0, 0.3))
    targets.rows["drawn"] = False
    predict(targets, np.linalg.inv(SIMILARITY), 0.0)
    centre = SIMILARITY @ [30.0, 40.0, 1.0]
    np.testing.assert_allclose(targets.rows["window"][0], [centre[0], centre[1], 30.0, 15.0, 0.8], atol=1e-9)
    np.testing.assert_array_equal(targets.rows["last_position"][0], [30.0, 40.0])


def test_a_drawn_window_only_moves():
    """A person stays upright, and as large, under a camera that turns and comes down around them."""
    targets = table((30.0, 40.0, 20.0, 10.0, 0.3))
    predict(targets, np.linalg.inv(SIMILARITY), 0.0)
    centre = SIMILARITY @ [30.0, 40.0, 1.0]
    np.testing.assert_allclose(targets.rows["window"][0], [centre[0], centre[1], 20.0, 10.0, 0.3], atol=1e-9)
