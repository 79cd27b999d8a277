"""The constant-velocity filter."""

import numpy as np

from streamkit_tracker import kinematics


def follow(steps: list[float], noise: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance after following a steady mover."""
    generator = np.random.default_rng(0)
    means, covariances = np.zeros((1, 4)), kinematics.initial_covariance(1.0, 100.0)[None]
    time = 0.0
    for step in steps:
        time += step
        means, covariances = kinematics.predict(means, covariances, step, np.array([20.0]))
        seen = np.array([[60.0, -25.0]]) * time + noise * generator.standard_normal((1, 2))
        means, covariances = kinematics.correct(means, covariances, seen, noise**2 * np.eye(2)[None])
    return means[0], covariances[0]


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
    means, _ = kinematics.carry(np.array([[2.0, 1.0, 5.0, 0.0]]), np.eye(4)[None], quarter)
    np.testing.assert_allclose(means[0], [-1.0, 2.0, 0.0, 5.0], atol=1e-12)
