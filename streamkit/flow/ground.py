"""Ground coordinates of the targets of a frame with a pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from streamkit.flow.metadata import Pose, Tracks
from streamkit.geometry.camera import Camera, ground_coordinates

if TYPE_CHECKING:
    from streamkit.flow.frame import Frame


def ground_positions(frame: Frame, ground_altitude_m: float) -> dict[int, tuple[float, float]]:
    """Latitude and longitude (deg, WGS84) of targets on flat ground, by id.

    Targets whose ray does not meet the ground are left out; all are without a current, complete pose.

    Args:
        frame: with `Tracks`, `Pose` and its size in the caps.
        ground_altitude_m: altitude of the ground, with the datum of the pose.
    """
    pose, tracks = frame.get(Pose), frame.get(Tracks)
    if pose is None or tracks is None or not tracks.tracks or pose.is_stale:
        return {}
    if pose.altitude is None or pose.heading is None or pose.field_of_view is None:
        return {}
    width, height = frame.caps.get("width"), frame.caps.get("height")
    if not (isinstance(width, int) and isinstance(height, int)):
        return {}
    camera = Camera(
        pose.latitude,
        pose.longitude,
        pose.altitude - ground_altitude_m,
        (pose.heading, pose.pitch or 0.0, pose.roll or 0.0),
        pose.sensor_angles or (0.0, 0.0, 0.0),
        pose.field_of_view,
        (width, height),
    )
    found = ground_coordinates(camera, np.array([(track.x, track.y) for track in tracks.tracks]))
    return {
        track.id: (float(latitude), float(longitude))
        for track, (latitude, longitude) in zip(tracks.tracks, found, strict=True)
        if np.isfinite(latitude)
    }
