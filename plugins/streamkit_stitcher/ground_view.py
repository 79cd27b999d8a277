"""What a frame shows of the ground, by the pose that it carries."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from streamkit.geometry.camera import ground_coordinates
from streamkit.geometry.homography import FloatArray, centre
from streamkit.geometry.pose import Pose
from streamkit.geometry.posed_camera import POSITION_STD_M, has_heading, lean, place_std_m, posed_camera
from streamkit_stitcher.mosaic.georeference import GroundView

_SENT_STD_M: Final = 5.0
# Of a camera within this angle of straight down, the position alone is good enough.
_NADIR: Final = math.radians(15.0)


def ground_view(
    pose: Pose | None,
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
    if pose is None:
        return "no current position; posesync before stitch attaches those of the telemetry"
    if pose.is_stale:
        return "no current position"
    shown = _ground_places(pose, shape, ground_altitude, field_of_view)
    if isinstance(shown, str):
        return shown
    places, std_m = shown
    focal_px = _focal_px(pose, shape, field_of_view)
    camera = np.array([pose.latitude, pose.longitude]) if focal_px else None
    time_s = None if pts is None else pts / 1e9
    return GroundView(_points(shape)[: len(places)], places, std_m, time_s, focal_px, camera)


def _ground_places(
    pose: Pose, shape: tuple[int, int], ground_altitude: float | None, field_of_view: float
) -> tuple[FloatArray, float] | str:
    """Latitude and longitude of centre and corners, float64[1 or 5, 2], and their standard deviation, m."""
    if pose.frame_centre is not None:
        corners = pose.corners if len(pose.corners) == 4 else ()
        return np.array([pose.frame_centre[:2], *corners]), _SENT_STD_M
    below = np.array([[pose.latitude, pose.longitude]]), POSITION_STD_M
    if pose.sensor_angles is None or not has_heading(pose):
        return below
    angle = lean(pose, shape)
    if angle is None:
        return "the camera looks at the horizon"
    camera = posed_camera(pose, shape, ground_altitude, field_of_view)
    if isinstance(camera, str):
        aside = f"the camera looks {math.degrees(angle):.0f} deg aside and {camera}"
        return below if angle < _NADIR else aside
    places = ground_coordinates(camera, _points(shape))
    if not np.isfinite(places).all():
        places = places[:1]
    return places, float(place_std_m(camera, places[:1])[0])


def _points(shape: tuple[int, int]) -> FloatArray:
    """Centre and corners of a frame, float64[5, 2]: upper left, then clockwise."""
    height, width = shape
    right, bottom = width - 0.5, height - 0.5
    return np.array([centre(shape), (-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom)])


def _focal_px(pose: Pose, shape: tuple[int, int], field_of_view: float) -> float:
    """Focal length of a camera that looks about straight down; 0 if it does not, or is unknown."""
    view = field_of_view if pose.field_of_view is None else pose.field_of_view[0]
    if pose.sensor_angles is None and pose.field_of_view is not None and pose.source.startswith("dji"):
        # The gimbal may look aside, where 5 % of the focal length bend a strip of 12 frames by 20 px.
        return 0.0
    angle = 0.0 if pose.sensor_angles is None else lean(pose, shape)
    if not view > 0 or angle is None or angle > _NADIR:
        return 0.0
    return shape[1] / 2 / math.tan(view / 2)
