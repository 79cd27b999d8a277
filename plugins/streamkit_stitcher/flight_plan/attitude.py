"""Camera tilt from the attitude of aircraft and gimbal."""

import math

import numpy as np

from streamkit.geometry.homography import FloatArray

STRAIGHT_DOWN = (0.0, -math.pi / 2, 0.0)
"""Azimuth, elevation and roll of a sensor that looks straight down."""


def camera_tilt(pitch: float, roll: float, sensor_angles: tuple[float, float, float]) -> tuple[float, float]:
    """The tilt of a camera about its image axes, as `rectification.levelling` removes it.

    Args:
        pitch: of the platform, nose up positive, rad.
        roll: of the platform, right wing down positive, rad.
        sensor_angles: azimuth, elevation and roll of the sensor relative to the platform, rad.

    Returns:
        Roll and pitch of the camera, rad: zero for one that looks straight down, at any heading.

    Source: MISB ST 0601, tags 6, 7 and 18 to 20, for the signs of the angles.
    """
    azimuth, elevation, turn = sensor_angles
    # The axes of both bodies are forward, right, down; the camera's forward is its optical axis.
    sensor = rotation(pitch, roll, 0.0) @ rotation(elevation, turn, azimuth)
    forward, right, down = sensor[2]
    along = math.atan2(down, forward)
    return math.atan2(-right, math.hypot(down, forward)), along


def rotation(pitch: float, roll: float, yaw: float) -> FloatArray:
    """float64[3, 3], a body's axes (forward, right, down) to its parent's: roll, then pitch, then yaw."""
    (cp, sp), (cr, sr), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in (pitch, roll, yaw))
    about_forward = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_right = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_down = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_down @ about_right @ about_forward, dtype=np.float64)
