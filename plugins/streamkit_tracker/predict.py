"""Constant-velocity Kalman filter of all targets, on pixels of the current frame.

The state is x, y (px) and vx, vy (px/s) in the coordinates of the latest frame, without the camera's motion.
Registration carries it from frame to frame, so a change of the reference plane leaves it alone.
"""

from __future__ import annotations

import numpy as np

from streamkit.geometry.homography import inverse, is_invertible
from streamkit_tracker.targets import TargetRows, TargetTable
from streamkit_tracker.window_geometry import (
    ANGLE,
    IDENTITY,
    LENGTH,
    MINIMUM_SIDE,
    NO_SCALE,
    WIDTH,
    FloatArray,
    half_turn,
    map_points,
)

MIN_SIDE = 10.0  # px, that accelerations are relative to
ACCELERATION = 2.0  # sides per s^2, of targets drawn by hand
DETECTED_ACCELERATION = 1.6  # of the others at least: people walk more steadily than their boxes show
TURN_RATE = 1.5  # rad/s, of the others: a car that turns is accelerated by far more sides per s^2


def predict(table: TargetTable, to_previous: FloatArray, step_s: float) -> None:
    """Carries every target to this frame's pixels and ahead by the time between the frames.

    Args:
        table: of the previous frame.
        to_previous: float64[3, 3], this frame's pixels to the previous frame's; not used if it is singular.
        step_s: time between the frames, s, above 0.
    """
    rows = table.rows
    if is_invertible(to_previous):
        # the trail of a target that its detections have confirmed is not used any more
        trailed = [model for model in table.models if model.template is None or model.drawn is not None]
        clouds = [model.particles for model in table.models if model.particles is not None]
        points = [rows["mean"][:, :2], rows["window"][:, :2]]
        points += [model.trail for model in trailed] + [particles.positions for particles in clouds]
        mapped, jacobians = map_points(inverse(to_previous), np.concatenate(points))
        carry_states(rows, mapped, jacobians)
        begin = 2 * len(rows)  # np.split takes longer than all else here
        for model in trailed:
            model.trail = mapped[begin : begin + len(model.trail)]
            begin += len(model.trail)
        for particles in clouds:
            particles.positions = mapped[begin : begin + len(particles.positions)]
            begin += len(particles.positions)
    advance(rows, step_s)
    rows["predicted"] = rows["mean"][:, :2]


def carry_states(targets: TargetRows, mapped: FloatArray, jacobians: FloatArray) -> None:
    """Moves means and windows, turns velocities and covariances, and resizes and turns windows.

    A window's length follows its direction; its width keeps the mapped area. Windows drawn by hand only move:
    what the camera follows neither grows nor turns with the ground beneath it, and people stay upright while
    the camera turns around them. Their filters find the size, their templates the turn.

    Args:
        targets: n rows.
        mapped: float64[2 n or more, 2], the mapped positions of the means, then of the windows.
        jacobians: float64[2 n or more, 2, 2], of the map there.
    """
    count, mean, window = len(targets), targets["mean"], targets["window"]
    both = np.zeros((count, 4, 4))
    both[:, :2, :2] = both[:, 2:, 2:] = jacobians[:count]
    mean[:, :2] = mapped[:count]
    mean[:, 2:] = np.matvec(jacobians[:count], mean[:, 2:])
    targets["covariance"] = both @ targets["covariance"] @ both.swapaxes(1, 2)
    window[:, :2] = mapped[count : 2 * count]
    index = np.flatnonzero(~targets["drawn"])
    around, (length, width, angle) = jacobians[count + index], window[index, LENGTH:].T
    x, y = np.matvec(around, np.stack([np.cos(angle), np.sin(angle)], axis=1)).T
    stretch = np.maximum(np.hypot(x, y), NO_SCALE)
    area = np.abs(np.linalg.det(around))
    window[index, LENGTH] = np.maximum(length * stretch, MINIMUM_SIDE)
    window[index, WIDTH] = np.maximum(width * area / stretch, MINIMUM_SIDE)
    window[index, ANGLE] = half_turn(np.arctan2(y, x))


def advance(targets: TargetRows, step_s: float) -> None:
    """Moves states ahead; the acceleration is white noise relative to the target's side, or to its speed.

    Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking, section 6.3.2.
    """
    motion = np.eye(4) + step_s * np.eye(4, k=2)
    gain = np.concatenate([step_s**2 / 2 * IDENTITY, step_s * IDENTITY])
    sides = np.maximum(np.sqrt(targets["window"][:, LENGTH] * targets["window"][:, WIDTH]), MIN_SIDE)
    turning = TURN_RATE * np.hypot(targets["mean"][:, 2], targets["mean"][:, 3])
    detected = np.maximum(DETECTED_ACCELERATION * sides, turning)
    acceleration = np.where(targets["drawn"], ACCELERATION * sides, detected)
    targets["mean"] = targets["mean"] @ motion.T
    noise = acceleration[:, None, None] ** 2 * (gain @ gain.T)
    targets["covariance"] = motion @ targets["covariance"] @ motion.T + noise


def correct(targets: TargetRows) -> None:
    """Corrects the states of measured targets, in Joseph's form: covariances stay symmetric and positive."""
    index = np.flatnonzero(targets["measured"])
    if not len(index):
        return
    covariance, noise = targets["covariance"][index], targets["noise"][index]
    gain = covariance[:, :, :2] @ np.linalg.inv(covariance[:, :2, :2] + noise)
    error = targets["measurement"][index] - targets["mean"][index, :2]
    targets["mean"][index] += np.matvec(gain, error)
    # with H of the first two rows of the identity: (I - K H) P (I - K H)' + K R K'
    once = covariance - gain @ covariance[:, :2]
    new = once - (once[:, :, :2] - gain @ noise) @ gain.swapaxes(1, 2)
    targets["covariance"][index] = 0.5 * (new + new.swapaxes(1, 2))
