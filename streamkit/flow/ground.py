"""Ground coordinates of the targets of a frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from streamkit.flow.metadata import GroundReference, Tracks
from streamkit.geometry.camera import FloatArray, ground_coordinates
from streamkit.geometry.earth import metres_per_degree
from streamkit.geometry.homography import project
from streamkit.geometry.pose import Pose
from streamkit.geometry.posed_camera import place_std_m, posed_camera

if TYPE_CHECKING:
    from streamkit.flow.frame import Frame

# Latitude and longitude, deg, WGS84, and their standard deviation, m.
GroundPosition = tuple[float, float, float]


def ground_positions(frame: Frame, ground_altitude_m: float | None) -> tuple[dict[int, GroundPosition], str]:
    """Positions of targets on flat ground, by id, and why there are none, or "".

    By the frame's `GroundReference`, else by its current `Pose`. Targets whose ray does not meet the ground
    are left out.

    Args:
        frame: with `Tracks` and its size in the caps.
        ground_altitude_m: altitude of the ground, with the datum of the pose; None to take it from the pose.
    """
    tracks = frame.get(Tracks)
    if tracks is None or not tracks.tracks:
        return {}, "no targets"
    pixels = np.array([(track.x, track.y) for track in tracks.tracks])
    places = _places(frame, pixels, ground_altitude_m)
    if isinstance(places, str):
        return {}, places
    found = {
        track.id: (float(latitude), float(longitude), float(std_m))
        for track, (latitude, longitude, std_m) in zip(tracks.tracks, places, strict=True)
        if np.isfinite(latitude)
    }
    return found, "" if found else "no target is where its line of sight meets the ground"


def _places(frame: Frame, pixels: FloatArray, ground_altitude_m: float | None) -> FloatArray | str:
    """Latitude, longitude and standard deviation of pixels, float64[n, 3], or why they are unknown."""
    reference, pose = frame.get(GroundReference), frame.get(Pose)
    if reference is not None:
        metres = project(reference.to_local, pixels)
        origin = reference.latitude, reference.longitude
        degrees = metres[:, ::-1] / metres_per_degree(reference.latitude) + origin
        return np.column_stack([degrees, reference.error_at(metres)])
    if pose is None:
        return "no pose; pair telemetry with posesync"
    if pose.is_stale:
        return (
            "telemetry is too far from the frames in time; put stitch before it, or set max-gap-s of posesync"
        )
    width, height = frame.caps.get("width"), frame.caps.get("height")
    if not (isinstance(width, int) and isinstance(height, int)):
        return "the size of the frames is unknown"
    camera = posed_camera(pose, (height, width), ground_altitude_m)
    if isinstance(camera, str):
        return camera
    places = ground_coordinates(camera, pixels)
    return np.column_stack([places, place_std_m(camera, places)])
