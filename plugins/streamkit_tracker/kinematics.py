"""Constant-velocity Kalman filter of many targets at once, on pixels of the current frame.

A row of the state is x, y (px) and vx, vy (px/s), all in the coordinates of the latest frame with the
camera's own motion taken out. Registration carries the rows from frame to frame, so that a change of the
reference plane leaves them alone.
"""

from __future__ import annotations

import numpy as np

from streamkit_tracker.window_geometry import FloatArray, map_points


def initial_covariance(position_std: float, speed_std: float) -> FloatArray:
    """float64[4, 4] of a target just seen, whose velocity is unknown."""
    return np.diag([position_std**2, position_std**2, speed_std**2, speed_std**2])


def carry(
    means: FloatArray, covariances: FloatArray, homography: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Expresses states in the pixels of another frame.

    Args:
        means: float64[n, 4].
        covariances: float64[n, 4, 4].
        homography: float64[3, 3], old pixels to new pixels.

    Returns:
        The mapped means and covariances, velocities turned by the Jacobian at each position.
    """
    positions, jacobians = map_points(homography, means[:, :2])
    turn = np.zeros_like(covariances)
    turn[:, :2, :2] = turn[:, 2:, 2:] = jacobians
    velocities = np.einsum("nij,nj->ni", jacobians, means[:, 2:])
    return np.hstack([positions, velocities]), turn @ covariances @ turn.transpose(0, 2, 1)


def predict(
    means: FloatArray, covariances: FloatArray, step_s: float, acceleration_std: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Moves states ahead by the real time between two frames.

    Args:
        means: float64[n, 4].
        covariances: float64[n, 4, 4].
        step_s: s.
        acceleration_std: float64[n], px/s^2, white during the step.

    Returns:
        The predicted means and covariances.

    Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking, section 6.3.2.
    """
    transition = np.eye(4)
    transition[0, 2] = transition[1, 3] = step_s
    gain = np.array([[step_s**2 / 2, 0], [0, step_s**2 / 2], [step_s, 0], [0, step_s]])
    noise = gain @ gain.T
    predicted = transition @ covariances @ transition.T + acceleration_std[:, None, None] ** 2 * noise
    return means @ transition.T, predicted


def correct(
    means: FloatArray, covariances: FloatArray, positions: FloatArray, position_covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Corrects states by measured positions.

    Args:
        means: float64[n, 4].
        covariances: float64[n, 4, 4].
        positions: float64[n, 2], px.
        position_covariances: float64[n, 2, 2], px squared.

    Returns:
        The corrected means and covariances (Joseph form, so that they stay symmetric and positive).
    """
    innovation = covariances[:, :2, :2] + position_covariances
    gains = np.linalg.solve(innovation, covariances[:, :2]).transpose(0, 2, 1)
    keep = np.repeat(np.eye(4)[None], len(means), axis=0)
    keep[:, :, :2] -= gains
    corrected = keep @ covariances @ keep.transpose(0, 2, 1)
    corrected += gains @ position_covariances @ gains.transpose(0, 2, 1)
    moved = means + np.einsum("nij,nj->ni", gains, positions - means[:, :2])
    return moved, 0.5 * (corrected + corrected.transpose(0, 2, 1))
