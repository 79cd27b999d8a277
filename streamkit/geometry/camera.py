"""Camera: position and orientation above flat ground, and the ground coordinates of its pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streamkit.geometry.earth import metres_per_degree

FloatArray = NDArray[np.float64]

# Closer to the horizon than 3 deg a pixel is hundreds of metres long, and flat ground is no model.
MIN_DESCENT = math.sin(math.radians(3.0))


@dataclass(frozen=True)
class Camera:
    """Position and orientation of a camera.

    Attributes:
        latitude: deg, WGS84.
        longitude: deg, WGS84.
        height_m: above the ground.
        platform: heading (clockwise from north), pitch (nose up), roll (right wing down), rad.
        sensor: azimuth, elevation, roll of the sensor relative to the platform, rad.
        field_of_view: horizontal, vertical, rad.
        size: width, height of the frame, px.
    """

    latitude: float
    longitude: float
    height_m: float
    platform: tuple[float, float, float]
    sensor: tuple[float, float, float]
    field_of_view: tuple[float, float]
    size: tuple[int, int]


def ground_coordinates(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Latitude and longitude of pixels; NaN where the ray descends by less than 3 deg.

    Args:
        camera: the camera.
        pixels: float64[n, 2], x y, (0, 0) the centre of the top-left pixel.

    Returns:
        float64[n, 2], deg.

    Source: MISB ST 0601 (angles of platform and sensor); Torge, Geodesy, section 4.1 (radii of curvature).
    """
    width, height = camera.size
    across, down = (math.tan(angle / 2) for angle in camera.field_of_view)
    offsets = (np.asarray(pixels, dtype=np.float64) - ((width - 1) / 2, (height - 1) / 2)) / (
        width / 2,
        height / 2,
    )
    rays = np.column_stack([np.ones(len(offsets)), offsets[:, 0] * across, offsets[:, 1] * down])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    # North, east, down.
    directions = rays @ (rotation_matrix(*camera.platform) @ rotation_matrix(*camera.sensor)).T
    descent = np.where(directions[:, 2] >= MIN_DESCENT, directions[:, 2], math.nan)
    metres = directions[:, :2] * (camera.height_m / descent)[:, np.newaxis]
    degrees = metres / np.array(metres_per_degree(camera.latitude))
    return np.asarray(degrees + np.array([camera.latitude, camera.longitude]), dtype=np.float64)


def rotation_matrix(yaw: float, pitch: float, roll: float) -> FloatArray:
    """float64[3, 3], a body's axes (forward, right, down) to its parent's: roll, then pitch, then yaw."""
    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (math.cos, math.sin))
    about_down = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_right = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_forward = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return np.asarray(about_down @ about_right @ about_forward)
