"""Constant-velocity Kalman filter of all targets, on pixels of the current frame.

The state is x, y (px) and vx, vy (px/s) in the coordinates of the latest frame, without the camera's motion.
Registration carries it from frame to frame, so a change of the reference plane leaves it alone.
"""

from __future__ import annotations

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.initiate.trail import Trail
from streamkit_tracker.targets import TargetRows, TargetTable
from streamkit_tracker.update.layered_filter import Particles
from streamkit_tracker.window_geometry import (
    ANGLE,
    LENGTH,
    MINIMUM_SIDE,
    NO_SCALE,
    WIDTH,
    FloatArray,
    half_turn,
    invertible,
    map_points,
)

SMALLEST_SIDE = 10.0  # px, that accelerations are relative to
ACCELERATION = 2.0  # sides per s^2, of targets drawn by hand
OBJECT_ACCELERATION = 1.6  # of whole objects: people walk more steadily than their boxes show
REGION_ACCELERATION = 6.0  # the same where regions of motion correct what the wider search finds


def predict(table: TargetTable, to_previous: FloatArray, step_s: float, *, are_objects: bool = False) -> None:
    """Carries every target to this frame's pixels and ahead by the time between the frames.

    Args:
        table: of the previous frame.
        to_previous: float64[3, 3], this frame's pixels to the previous frame's; not used if it is singular.
        step_s: s, above 0.
        are_objects: whether detections are whole objects.
    """
    rows, homography = table.rows, invertible(to_previous)
    if homography is not None:
        # the trail of a target that its detections have confirmed is not used any more
        held: list[Trail | Particles] = [
            model.trail
            for model, manual in zip(table.models, rows["manual"].tolist(), strict=True)
            if manual or model.appearance is None
        ]
        held += [model.appearance.particles for model in table.models if model.appearance is not None]
        points = [rows["mean"][:, :2], rows["window"][:, :2], *[each.positions for each in held]]
        mapped, jacobians = map_points(homography, np.concatenate(points))
        carry_states(rows, mapped, jacobians)
        start = 2 * len(rows)
        for each in held:
            each.positions = mapped[start : start + len(each.positions)]
            start += len(each.positions)
    advance(rows, step_s, OBJECT_ACCELERATION if are_objects else REGION_ACCELERATION)


@compiled
def carry_states(targets: TargetRows, mapped: FloatArray, jacobians: FloatArray) -> None:
    """Moves means and windows, turns velocities and covariances, and resizes and turns windows.

    Args:
        targets: n rows.
        mapped: float64[2 n or more, 2], the mapped positions of the means, then of the windows.
        jacobians: float64[2 n or more, 2, 2], of the map there.
    """
    old, velocity = np.empty((4, 4)), np.empty(2)
    for index in range(len(targets)):
        target, turn = targets[index], jacobians[index]
        mean, covariance = target["mean"], target["covariance"]
        old[:] = covariance
        velocity[:] = mean[2:]
        mean[0], mean[1] = mapped[index, 0], mapped[index, 1]
        for row in range(2):
            mean[2 + row] = turn[row, 0] * velocity[0] + turn[row, 1] * velocity[1]
        for down in (0, 2):
            for along in (0, 2):
                block = old[down : down + 2, along : along + 2]
                for row in range(2):
                    left = turn[row, 0] * block[0, 0] + turn[row, 1] * block[1, 0]
                    right = turn[row, 0] * block[0, 1] + turn[row, 1] * block[1, 1]
                    for column in range(2):
                        total = left * turn[column, 0] + right * turn[column, 1]
                        covariance[down + row, along + column] = total
        window, place = target["window"], len(targets) + index
        before = window[ANGLE]
        resize_window(window, jacobians[place])
        window[0], window[1] = mapped[place, 0], mapped[place, 1]
        if target["manual"]:
            targets[index]["drawn_angle"] = target["drawn_angle"] + (window[ANGLE] - before)


@compiled
def resize_window(window: FloatArray, jacobian: FloatArray) -> None:
    """Maps sides and angle of a window: the length follows its direction, the width keeps the mapped area."""
    x = jacobian[0, 0] * np.cos(window[ANGLE]) + jacobian[0, 1] * np.sin(window[ANGLE])
    y = jacobian[1, 0] * np.cos(window[ANGLE]) + jacobian[1, 1] * np.sin(window[ANGLE])
    stretch = max(np.hypot(x, y), NO_SCALE)
    area_ratio = abs(jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0])
    window[LENGTH] = max(window[LENGTH] * stretch, MINIMUM_SIDE)
    window[WIDTH] = max(window[WIDTH] * area_ratio / stretch, MINIMUM_SIDE)
    window[ANGLE] = half_turn(np.arctan2(y, x))


@compiled
def advance(targets: TargetRows, step_s: float, detected_acceleration: float) -> None:
    """Moves states ahead; the acceleration is white noise relative to the target's side.

    Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking, section 6.3.2.
    """
    old = np.empty((4, 4))
    for index in range(len(targets)):
        target = targets[index]
        mean, new, window = target["mean"], target["covariance"], target["window"]
        side = max(np.sqrt(window[LENGTH] * window[WIDTH]), SMALLEST_SIDE)
        acceleration = side * (ACCELERATION if target["manual"] else detected_acceleration)
        variance = acceleration**2
        old[:] = new
        for row in range(2):
            mean[row] = mean[row] + step_s * mean[2 + row]
            for column in range(2):
                both = old[row, 2 + column] + old[2 + row, column]
                speed = old[2 + row, 2 + column]
                new[row, column] = old[row, column] + step_s * both + step_s**2 * speed
                new[row, 2 + column] = old[row, 2 + column] + step_s * speed
                new[2 + row, column] = old[2 + row, column] + step_s * speed
            new[row, row] += variance * step_s**4 / 4
            new[row, 2 + row] += variance * step_s**3 / 2
            new[2 + row, row] += variance * step_s**3 / 2
            new[2 + row, 2 + row] += variance * step_s**2


@compiled
def correct(targets: TargetRows) -> None:
    """Corrects the states of measured targets, in Joseph's form: covariances stay symmetric and positive."""
    gain, half = np.empty((4, 2)), np.empty((4, 4))
    for index in range(len(targets)):
        target = targets[index]
        if not target["measured"]:
            continue
        mean, new, noise, measurement = (
            target["mean"],
            target["covariance"],
            target["noise"],
            target["measurement"],
        )
        xx, yy = new[0, 0] + noise[0, 0], new[1, 1] + noise[1, 1]
        xy, yx = new[0, 1] + noise[0, 1], new[1, 0] + noise[1, 0]
        determinant = xx * yy - xy * yx
        x, y = measurement[0] - mean[0], measurement[1] - mean[1]
        for row in range(4):
            gain[row, 0] = (new[0, row] * yy - new[1, row] * xy) / determinant
            gain[row, 1] = (new[1, row] * xx - new[0, row] * yx) / determinant
            mean[row] = mean[row] + gain[row, 0] * x + gain[row, 1] * y
            for column in range(4):
                taken = gain[row, 0] * new[0, column] + gain[row, 1] * new[1, column]
                half[row, column] = new[row, column] - taken
        for row in range(4):
            across = gain[row, 0] * noise[0, 0] + gain[row, 1] * noise[1, 0] - half[row, 0]
            down = gain[row, 0] * noise[0, 1] + gain[row, 1] * noise[1, 1] - half[row, 1]
            for column in range(4):
                new[row, column] = half[row, column] + across * gain[column, 0] + down * gain[column, 1]
        for row in range(4):
            for column in range(row):
                new[row, column] = new[column, row] = 0.5 * (new[row, column] + new[column, row])
