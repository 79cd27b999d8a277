"""One sample of telemetry, whatever it was sent as, and the sample between two."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from streamkit.geometry.angles import wrap_bearing, wrap_turn

Position = tuple[float, float, float | None]
Angles = tuple[float, float, float]
Number = float | None
PoseFields = tuple[
    float, float, Number, Number, Number, Number, Angles | None, tuple[float, float] | None, str
]


@dataclass(frozen=True, slots=True)
class Sample:
    """Where the camera was and what it saw at one moment.

    Attributes:
        pts: on the video's line of time, ns.
        latitude: deg, WGS84.
        longitude: deg, WGS84.
        altitude: m; `source` says above what where it is not the ellipsoid.
        heading: of the platform, rad clockwise from true north.
        pitch: of the platform, rad, nose up.
        roll: of the platform, rad, right wing down.
        sensor_angles: azimuth, elevation, roll of the sensor relative to the platform, rad.
        field_of_view: horizontal, vertical, rad.
        frame_centre: latitude, longitude (deg) and elevation (m) of what the centre shows.
        corners: latitude, longitude (deg) of the image's corners: upper left, then clockwise; or empty.
        target: latitude, longitude (deg) and elevation (m) of the target.
        utc_ns: when, by the platform's clock.
        source: what it was sent as.
    """

    pts: int
    latitude: float
    longitude: float
    altitude: float | None = None
    heading: float | None = None
    pitch: float | None = None
    roll: float | None = None
    sensor_angles: tuple[float, float, float] | None = None
    field_of_view: tuple[float, float] | None = None
    frame_centre: Position | None = None
    corners: tuple[tuple[float, float], ...] = ()
    target: Position | None = None
    utc_ns: int | None = None
    source: str = ""

    @property
    def pose(self) -> PoseFields:
        """The camera's part of it, in the order of the fields of `streamkit.Pose`."""
        return (
            self.latitude, self.longitude, self.altitude, self.heading, self.pitch, self.roll,
            self.sensor_angles, self.field_of_view, self.source,
        )  # fmt: skip


def between(before: Sample, after: Sample, pts: int) -> Sample:
    """The sample at `pts` ns between two, interpolated linearly; angles take the shorter way."""
    share = (pts - before.pts) / (after.pts - before.pts)
    utc_ns = None
    if before.utc_ns is not None and after.utc_ns is not None:
        utc_ns = before.utc_ns + round((after.utc_ns - before.utc_ns) * share)
    nearer = before if share < 0.5 else after
    return replace(
        nearer,
        pts=pts,
        latitude=before.latitude + (after.latitude - before.latitude) * share,
        longitude=_longitude(before.longitude, after.longitude, share),
        altitude=_number(before.altitude, after.altitude, share, nearer.altitude),
        heading=_angle(before.heading, after.heading, share, nearer.heading),
        pitch=_angle(before.pitch, after.pitch, share, nearer.pitch, is_compass=False),
        roll=_angle(before.roll, after.roll, share, nearer.roll, is_compass=False),
        sensor_angles=_angles(before, after, share, nearer),
        field_of_view=_fields_of_view(before, after, share, nearer),
        frame_centre=_position(before.frame_centre, after.frame_centre, share, nearer.frame_centre),
        corners=_corners(before, after, share, nearer),
        target=_position(before.target, after.target, share, nearer.target),
        utc_ns=utc_ns if utc_ns is not None else nearer.utc_ns,
    )


def _number(a: float | None, b: float | None, share: float, other: float | None) -> float | None:
    return other if a is None or b is None else a + (b - a) * share


def _turn(a: float, b: float, share: float) -> float:
    """From a towards b on the shorter way round, rad."""
    return a + wrap_turn(b - a) * share


def _angle(
    a: float | None, b: float | None, share: float, other: float | None, is_compass: bool = True
) -> float | None:
    if a is None or b is None:
        return other
    turned = _turn(a, b, share)
    return wrap_bearing(turned) if is_compass else wrap_turn(turned)


def _longitude(a: float, b: float, share: float) -> float:
    return math.remainder(a + math.remainder(b - a, 360.0) * share, 360.0)


def _position(
    a: Position | None, b: Position | None, share: float, other: Position | None
) -> Position | None:
    if a is None or b is None:
        return other
    return a[0] + (b[0] - a[0]) * share, _longitude(a[1], b[1], share), _number(a[2], b[2], share, a[2])


def _angles(before: Sample, after: Sample, share: float, nearer: Sample) -> tuple[float, float, float] | None:
    a, b = before.sensor_angles, after.sensor_angles
    if a is None or b is None:
        return nearer.sensor_angles
    azimuth, elevation, roll = (_turn(x, y, share) for x, y in zip(a, b, strict=True))
    return wrap_bearing(azimuth), wrap_turn(elevation), wrap_bearing(roll)


def _fields_of_view(
    before: Sample, after: Sample, share: float, nearer: Sample
) -> tuple[float, float] | None:
    a, b = before.field_of_view, after.field_of_view
    if a is None or b is None:
        return nearer.field_of_view
    return a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share


def _corners(before: Sample, after: Sample, share: float, nearer: Sample) -> tuple[tuple[float, float], ...]:
    if len(before.corners) != len(after.corners):
        return nearer.corners
    return tuple(
        (a[0] + (b[0] - a[0]) * share, _longitude(a[1], b[1], share))
        for a, b in zip(before.corners, after.corners, strict=True)
    )
