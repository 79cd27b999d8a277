"""From a `Pose` to a `Camera`: what telemetry lacks for it, and how uncertain ground coordinates are."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from streamkit.geometry.camera import Camera, FloatArray, ground_coordinates
from streamkit.geometry.earth import metres_per_degree
from streamkit.geometry.pose import Pose

# Standard deviations of a position of satellite navigation, m, and of an attitude, rad.
POSITION_STD_M: Final = 3.0
_ATTITUDE_STD: Final = math.radians(1.0)
_MIN_HEIGHT_M: Final = 1.0
_STRAIGHT_DOWN: Final = (0.0, -math.pi / 2, 0.0)


def posed_camera(
    pose: Pose, shape: tuple[int, int], ground_altitude: float | None = None, field_of_view: float = 0.0
) -> Camera | str:
    """The camera of a frame, or what is missing for it.

    A camera whose angles to the platform are unknown looks straight down.

    Args:
        pose: of the frame.
        shape: height and width, px.
        ground_altitude: of the ground, m, with the datum of the pose; None to take it from the telemetry.
        field_of_view: horizontal, rad, where the pose has none; 0 if unknown.
    """
    height = height_above_ground(pose, ground_altitude)
    if height is None:
        ground = pose.ground_altitude if ground_altitude is None else ground_altitude
        if pose.altitude is not None and ground is not None:
            return (
                "the camera is less than 1 m above the ground, as before take-off; else set ground-altitude"
            )
        return "the camera's height above the ground is unknown; set ground-altitude"
    view = pose.field_of_view
    if view is None and field_of_view > 0:
        view = field_of_view, 2 * math.atan(math.tan(field_of_view / 2) * shape[0] / shape[1])
    if view is None:
        return "the camera's field of view is unknown; set field-of-view= or drone= of stitch"
    if not has_heading(pose):
        return "the camera's heading is unknown; put stitch before it, which measures how the camera moves"
    return _camera(pose, shape, height, view)


def height_above_ground(pose: Pose, ground_altitude: float | None) -> float | None:
    """Height of the camera above the ground, m; None where it is unknown or less than 1 m."""
    ground = pose.ground_altitude if ground_altitude is None else ground_altitude
    if pose.altitude is None or ground is None:
        return None
    height = pose.altitude - ground
    return height if height > _MIN_HEIGHT_M else None


def has_heading(pose: Pose) -> bool:
    """Whether north is known in the frame: DJI gives the angles of the gimbal relative to north."""
    is_to_north = pose.sensor_angles is not None and pose.source.startswith("dji")
    return pose.heading is not None or is_to_north


def lean(pose: Pose, shape: tuple[int, int]) -> float | None:
    """Angle between the camera's axis and straight down, rad; None near the horizon."""
    camera = _camera(pose, shape, 1.0, (1.0, 1.0))
    places = ground_coordinates(camera, np.array([[(shape[1] - 1) / 2, (shape[0] - 1) / 2]]))
    distance = float(_distances(camera, places)[0])
    return math.atan(distance) if math.isfinite(distance) else None


def place_std_m(camera: Camera, places: FloatArray) -> FloatArray:
    """Standard deviations, m, of the ground coordinates float64[n, 2] that a camera sees, float64[n].

    Of the position, and of an attitude that is off by one degree.
    """
    secant_squared = 1 + (_distances(camera, places) / camera.height_m) ** 2
    return np.hypot(POSITION_STD_M, _ATTITUDE_STD * camera.height_m * secant_squared)


def _distances(camera: Camera, places: FloatArray) -> FloatArray:
    """Horizontal distances of places (deg) from the camera, m."""
    metres = (places - (camera.latitude, camera.longitude)) * metres_per_degree(camera.latitude)
    return np.asarray(np.hypot(*metres.T), dtype=np.float64)


def _camera(pose: Pose, shape: tuple[int, int], height: float, view: tuple[float, float]) -> Camera:
    return Camera(
        pose.latitude,
        pose.longitude,
        height,
        (pose.heading or 0.0, pose.pitch or 0.0, pose.roll or 0.0)
        if pose.sensor_angles is not None
        # A gimbal levels the camera.
        else (pose.heading or 0.0, 0.0, 0.0),
        pose.sensor_angles or _STRAIGHT_DOWN,
        view,
        (shape[1], shape[0]),
    )
