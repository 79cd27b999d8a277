"""Constant-velocity Kalman filter of many targets at once, on pixels of the current frame.

A row of the state is x, y (px) and vx, vy (px/s), all in the coordinates of the latest frame with the
camera's own motion taken out. Registration carries the rows from frame to frame, so that a change of the
reference plane leaves them alone.
"""

from __future__ import annotations

import math

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import FloatArray, map_points

HEADED = 3.0  # standard deviations of the speed from which its direction is known
LEAST_SPEED = 0.3  # sides per second, likewise
LEAST_HEADING_STD = 0.08  # rad


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
    carried, turned = np.empty_like(means), np.empty_like(covariances)
    carried[:, :2] = positions
    _turn(means, covariances, jacobians, carried, turned)
    return carried, turned


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
    moved, predicted = np.empty_like(means), np.empty_like(covariances)
    _advance(means, covariances, step_s, acceleration_std**2, moved, predicted)
    return moved, predicted


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
    moved, corrected = np.empty_like(means), np.empty_like(covariances)
    _weigh(means, covariances, positions, position_covariances, moved, corrected)
    return moved, corrected


def position_std(covariance: FloatArray) -> float:
    """Standard deviation of either coordinate, px, of a state's covariance float64[4, 4]."""
    return math.sqrt((covariance.item(0, 0) + covariance.item(1, 1)) / 2)


def speed_std(covariance: FloatArray) -> float:
    """Standard deviation of either part of the velocity, px/s, of a state's covariance float64[4, 4]."""
    return math.sqrt((covariance.item(2, 2) + covariance.item(3, 3)) / 2)


def heading(mean: FloatArray, covariance: FloatArray, side: float) -> tuple[float | None, float]:
    """Direction of motion in the frame and its standard deviation, rad, or None while it is not known.

    Args:
        mean: float64[4] of one state.
        covariance: float64[4, 4].
        side: of the target, px: what moves slowly for its size may turn on the spot.
    """
    _, _, across, down = mean.tolist()
    speed, deviation = math.hypot(across, down), speed_std(covariance)
    if speed < HEADED * deviation or speed < LEAST_SPEED * side:
        return None, math.inf
    return math.atan2(down, across), max(LEAST_HEADING_STD, 1.5 * deviation / speed)


def headings(means: FloatArray, covariances: FloatArray, sides: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`heading` of n states: float64[n], NaN while it is not known, and float64[n], rad."""
    directions, deviations = np.empty(len(means)), np.empty(len(means))
    _head(means, covariances, sides, directions, deviations)
    return directions, deviations


@compiled
def _head(
    means: FloatArray,
    covariances: FloatArray,
    sides: FloatArray,
    directions: FloatArray,
    deviations: FloatArray,
) -> None:
    """Fills in the directions of motion and their standard deviations."""
    for state in range(len(means)):
        across, down = means[state, 2], means[state, 3]
        speed = np.hypot(across, down)
        deviation = np.sqrt((covariances[state, 2, 2] + covariances[state, 3, 3]) / 2)
        known = speed >= HEADED * deviation and speed >= LEAST_SPEED * sides[state]
        directions[state] = np.arctan2(down, across) if known else np.nan
        deviations[state] = max(LEAST_HEADING_STD, 1.5 * deviation / speed) if known else np.inf


@compiled
def _turn(
    means: FloatArray, covariances: FloatArray, jacobians: FloatArray, carried: FloatArray, turned: FloatArray
) -> None:
    """Turns velocities and every 2x2 block of the covariances by the Jacobians."""
    for state in range(len(means)):
        turn, velocity = jacobians[state], means[state, 2:]
        for row in range(2):
            carried[state, 2 + row] = turn[row, 0] * velocity[0] + turn[row, 1] * velocity[1]
        for down in (0, 2):
            for along in (0, 2):
                block = covariances[state, down : down + 2, along : along + 2]
                for row in range(2):
                    left = turn[row, 0] * block[0, 0] + turn[row, 1] * block[1, 0]
                    right = turn[row, 0] * block[0, 1] + turn[row, 1] * block[1, 1]
                    for column in range(2):
                        total = left * turn[column, 0] + right * turn[column, 1]
                        turned[state, down + row, along + column] = total


@compiled
def _advance(
    means: FloatArray,
    covariances: FloatArray,
    step_s: float,
    variances: FloatArray,
    moved: FloatArray,
    predicted: FloatArray,
) -> None:
    """Adds velocity to position, the covariance's blocks likewise, and the noise of the acceleration."""
    for state in range(len(means)):
        old, new = covariances[state], predicted[state]
        for row in range(2):
            moved[state, row] = means[state, row] + step_s * means[state, 2 + row]
            moved[state, 2 + row] = means[state, 2 + row]
            for column in range(2):
                both = old[row, 2 + column] + old[2 + row, column]
                speed = old[2 + row, 2 + column]
                new[row, column] = old[row, column] + step_s * both + step_s**2 * speed
                new[row, 2 + column] = old[row, 2 + column] + step_s * speed
                new[2 + row, column] = old[2 + row, column] + step_s * speed
                new[2 + row, 2 + column] = speed
            new[row, row] += variances[state] * step_s**4 / 4
            new[row, 2 + row] += variances[state] * step_s**3 / 2
            new[2 + row, row] += variances[state] * step_s**3 / 2
            new[2 + row, 2 + row] += variances[state] * step_s**2


@compiled
def _weigh(
    means: FloatArray,
    covariances: FloatArray,
    positions: FloatArray,
    noises: FloatArray,
    moved: FloatArray,
    corrected: FloatArray,
) -> None:
    """Kalman's correction in the form of Joseph, the covariances made symmetric."""
    gain, half = np.empty((4, 2)), np.empty((4, 4))
    for state in range(len(means)):
        old, noise, new = covariances[state], noises[state], corrected[state]
        xx, yy = old[0, 0] + noise[0, 0], old[1, 1] + noise[1, 1]
        xy, yx = old[0, 1] + noise[0, 1], old[1, 0] + noise[1, 0]
        determinant = xx * yy - xy * yx
        x, y = positions[state, 0] - means[state, 0], positions[state, 1] - means[state, 1]
        for row in range(4):
            gain[row, 0] = (old[0, row] * yy - old[1, row] * xy) / determinant
            gain[row, 1] = (old[1, row] * xx - old[0, row] * yx) / determinant
            moved[state, row] = means[state, row] + gain[row, 0] * x + gain[row, 1] * y
            for column in range(4):
                taken = gain[row, 0] * old[0, column] + gain[row, 1] * old[1, column]
                half[row, column] = old[row, column] - taken
        for row in range(4):
            across = gain[row, 0] * noise[0, 0] + gain[row, 1] * noise[1, 0] - half[row, 0]
            down = gain[row, 0] * noise[0, 1] + gain[row, 1] * noise[1, 1] - half[row, 1]
            for column in range(4):
                new[row, column] = half[row, column] + across * gain[column, 0] + down * gain[column, 1]
        for row in range(4):
            for column in range(row):
                new[row, column] = new[column, row] = 0.5 * (new[row, column] + new[column, row])
