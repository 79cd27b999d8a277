"""Pose: position and orientation of the camera, as telemetry has them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Pose:
    """Position and orientation of the camera.

    Attributes:
        latitude, longitude: deg, WGS84.
        altitude: m above the ellipsoid unless `source` says otherwise.
        heading, pitch, roll: of the platform, rad; heading clockwise from north.
        sensor_angles: azimuth, elevation, roll of the sensor to the platform, rad.
        field_of_view: horizontal, vertical, rad.
        source: "misb", "dji", "exif", ...
        gap_ns: from the frame to the nearest measurement; negative if that is older.
        is_stale: whether that gap is too long for the pose to be reliable.
        frame_centre: latitude, longitude (deg), elevation (m) of what the frame's centre shows, as sent.
        corners: latitude, longitude (deg) of what its corners show, as sent: upper left, then clockwise.
        ground_altitude: of the ground, m, with the datum of `altitude`, as far as telemetry has it: the
            take-off, or what the frame shows.
    """

    latitude: float
    longitude: float
    altitude: float | None = None
    heading: float | None = None
    pitch: float | None = None
    roll: float | None = None
    sensor_angles: tuple[float, float, float] | None = None
    field_of_view: tuple[float, float] | None = None
    source: str = ""
    gap_ns: int = 0
    is_stale: bool = False
    frame_centre: tuple[float, float, float | None] | None = None
    corners: tuple[tuple[float, float], ...] = ()
    ground_altitude: float | None = None
