"""What a frame shows of the ground, by the pose that it carries."""

from __future__ import annotations

import math
from typing import Final, Protocol

import numpy as np

from streamkit.geometry.camera import Camera, ground_coordinates
from streamkit.geometry.homography import FloatArray, centre
from streamkit_stitcher.flight_plan.plan import GeodeticPoint
from streamkit_stitcher.mosaic.georeference import GroundView

# Standard deviations of a position of satellite navigation, m, and of an attitude, rad.
_POSITION_STD_M: Final = 3.0
_ATTITUDE_STD: Final = math.radians(1.0)
_SENT_STD_M: Final = 5.0
# Of a camera within this angle of straight down, the position alone is good enough.
_NADIR: Final = math.radians(15.0)
_LEAST_HEIGHT_M: Final = 1.0
_ABOVE_GROUND: Final = ("above take-off", "above ground")


class _Pose(Protocol):
    """The fields of `streamkit.Pose` that are used."""

    # fmt: off
    @property
    def latitude(self) -> float: ...
    @property
    def longitude(self) -> float: ...
    @property
    def altitude(self) -> float | None: ...
    @property
    def heading(self) -> float | None: ...
    @property
    def pitch(self) -> float | None: ...
    @property
    def roll(self) -> float | None: ...
    @property
    def sensor_angles(self) -> tuple[float, float, float] | None: ...
    @property
    def field_of_view(self) -> tuple[float, float] | None: ...
    @property
    def source(self) -> str: ...
    @property
    def is_stale(self) -> bool: ...
    @property
    def frame_centre(self) -> tuple[float, float, float | None] | None: ...
    @property
    def corners(self) -> tuple[tuple[float, float], ...]: ...
    # fmt: on


def ground_view(
    pose: _Pose | None,
    shape: tuple[int, int],
    ground_altitude: float | None,
    field_of_view: float,
    pts: int | None,
) -> GroundView | str:
    """Ground positions of a frame's centre and, where they are known, of its corners; or why there are none.

    In this order: corners and centre as the telemetry has them; position, attitude, field of view and height;
    the position alone of a camera that looks straight down, as one without any attitude is taken to do.

    Args:
        pose: of the frame, or None.
        shape: height and width, px.
        ground_altitude: of the ground, m, with the datum of the pose; None to take it from the telemetry.
        field_of_view: horizontal, rad, where the pose has none; 0 if unknown.
        pts: of the frame, ns.
    """
    if pose is None or pose.is_stale:
        return "no current position"
    shown = _ground_places(pose, shape, ground_altitude, field_of_view)
    if isinstance(shown, str):
        return shown
    places, std_m = shown
    points = tuple(GeodeticPoint(latitude, longitude) for latitude, longitude in places)
    return GroundView(_points(shape)[: len(points)], points, std_m, None if pts is None else pts / 1e9)


def _ground_places(
    pose: _Pose, shape: tuple[int, int], ground_altitude: float | None, field_of_view: float
) -> tuple[tuple[tuple[float, float], ...], float] | str:
    """Latitude and longitude of centre and corners, deg, and their standard deviation, m."""
    if pose.frame_centre is not None and len(pose.corners) == 4:
        return (pose.frame_centre[:2], *pose.corners), _SENT_STD_M
    if pose.frame_centre is not None:
        return (pose.frame_centre[:2],), _SENT_STD_M
    position = (pose.latitude, pose.longitude)
    is_dji = pose.source.startswith("dji")
    if pose.sensor_angles is None or (pose.heading is None and not is_dji):
        return (position,), _POSITION_STD_M
    height = _height(pose, ground_altitude)
    view = _field_of_view(pose, shape, field_of_view)
    lean = _lean(pose, shape)
    if lean is None:
        return "the camera looks at the horizon"
    if height is None or view is None:
        if lean < _NADIR:
            return (position,), _POSITION_STD_M
        unknown = "field-of-view" if view is None else "ground-altitude"
        return f"the camera looks {math.degrees(lean):.0f} deg aside and nothing tells its {unknown}; set it"
    places = ground_coordinates(_camera(pose, shape, height, view), _points(shape))
    if not np.isfinite(places).all():
        places = places[:1]
    std = math.hypot(_POSITION_STD_M, _ATTITUDE_STD * height / math.cos(lean) ** 2)
    return tuple((float(latitude), float(longitude)) for latitude, longitude in places), std


def _points(shape: tuple[int, int]) -> FloatArray:
    """Centre and corners of a frame, float64[5, 2]: upper left, then clockwise."""
    height, width = shape
    right, bottom = width - 0.5, height - 0.5
    return np.array([centre(shape), (-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom)])


def _height(pose: _Pose, ground_altitude: float | None) -> float | None:
    """Height above the ground, m; where only the take-off is known, the ground is as high as that."""
    if pose.altitude is None:
        return None
    if ground_altitude is None and not pose.source.endswith(_ABOVE_GROUND):
        return None
    height = pose.altitude - (ground_altitude or 0.0)
    return height if height > _LEAST_HEIGHT_M else None


def _field_of_view(pose: _Pose, shape: tuple[int, int], given: float) -> tuple[float, float] | None:
    """Horizontal and vertical, rad."""
    if pose.field_of_view is not None:
        return pose.field_of_view
    return (given, 2 * math.atan(math.tan(given / 2) * shape[0] / shape[1])) if given > 0 else None


def _lean(pose: _Pose, shape: tuple[int, int]) -> float | None:
    """Angle between the camera's axis and straight down, rad; None near the horizon."""
    camera = _camera(pose, shape, 1.0, (1.0, 1.0))
    level = Camera(0.0, 0.0, 1.0, camera.platform, camera.sensor, camera.field_of_view, camera.size)
    north, east = ground_coordinates(level, centre(shape)[np.newaxis])[0] * math.radians(6_371_000.0)
    return math.atan(math.hypot(north, east)) if math.isfinite(north) else None


def _camera(pose: _Pose, shape: tuple[int, int], height: float, view: tuple[float, float]) -> Camera:
    return Camera(
        pose.latitude,
        pose.longitude,
        height,
        (pose.heading or 0.0, pose.pitch or 0.0, pose.roll or 0.0),
        pose.sensor_angles or (0.0, 0.0, 0.0),
        view,
        (shape[1], shape[0]),
    )
