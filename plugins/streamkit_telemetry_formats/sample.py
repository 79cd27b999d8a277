"""One sample of telemetry, whatever it was sent as, and the sample between two."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

from streamkit.geometry.angles import wrap_bearing, wrap_turn

Position = tuple[float, float, float | None]
# What a value is between two of them, at a share of the way.
Interpolation = Callable[[Any, Any, float], Any]


@dataclass(frozen=True, slots=True)
class Sample:
    """Where the camera was and what it saw at one moment."""

    pts: int  # on the video's line of time, ns
    latitude: float  # deg, WGS84
    longitude: float  # deg, WGS84
    altitude: float | None = None  # m; `source` says above what where it is not the ellipsoid
    heading: float | None = None  # of the platform, rad clockwise from true north
    pitch: float | None = None  # of the platform, rad, nose up
    roll: float | None = None  # of the platform, rad, right wing down
    # azimuth, elevation, roll of the sensor relative to the platform, rad
    sensor_angles: tuple[float, float, float] | None = None
    field_of_view: tuple[float, float] | None = None  # horizontal, vertical, rad
    # latitude, longitude (deg) and elevation (m) of what the centre shows
    frame_centre: Position | None = None
    # latitude, longitude (deg) of the image's corners: upper left, then clockwise; or empty
    corners: tuple[tuple[float, float], ...] = ()
    target: Position | None = None  # latitude, longitude (deg) and elevation (m) of the target
    utc_ns: int | None = None  # when, by the platform's clock
    source: str = ""  # what it was sent as
    # of the ground, m, with the datum of `altitude`: of the take-off, or of what the frame shows
    ground_altitude: float | None = None

    @property
    def pose(self) -> dict[str, Any]:
        """The fields that `streamkit.Pose` has too, by name."""
        return {name: getattr(self, name) for name in POSE_FIELDS}


POSE_FIELDS = tuple(field.name for field in fields(Sample) if field.name not in ("pts", "target", "utc_ns"))


def between(before: Sample, after: Sample, pts: int) -> Sample:
    """The sample at `pts` ns between two, interpolated linearly; angles take the shorter way.

    A field that one of them lacks is that of the nearer one.
    """
    share = (pts - before.pts) / (after.pts - before.pts)
    nearer = before if share < 0.5 else after
    mixed: dict[str, Any] = {"pts": pts}
    for name, mix in INTERPOLATIONS.items():
        a, b = getattr(before, name), getattr(after, name)
        if a is not None and b is not None:
            mixed[name] = mix(a, b, share)
    if len(before.corners) == len(after.corners):
        corners = zip(before.corners, after.corners, strict=True)
        mixed["corners"] = tuple(_point(a, b, share) for a, b in corners)
    return replace(nearer, **mixed)


def _linear(a: float, b: float, share: float) -> float:
    return a + (b - a) * share


def _turn(a: float, b: float, share: float) -> float:
    return wrap_turn(a + wrap_turn(b - a) * share)


def _bearing(a: float, b: float, share: float) -> float:
    return wrap_bearing(a + wrap_turn(b - a) * share)


def _longitude(a: float, b: float, share: float) -> float:
    return math.remainder(a + math.remainder(b - a, 360.0) * share, 360.0)


def _point(a: tuple[float, float], b: tuple[float, float], share: float) -> tuple[float, float]:
    return _linear(a[0], b[0], share), _longitude(a[1], b[1], share)


def _position(a: Position, b: Position, share: float) -> Position:
    return *_point(a[:2], b[:2], share), a[2] if a[2] is None or b[2] is None else _linear(a[2], b[2], share)


def _each(*mixes: Interpolation) -> Interpolation:
    """Interpolates each number of a tuple in its own way."""
    return lambda a, b, share: tuple(mix(x, y, share) for mix, x, y in zip(mixes, a, b, strict=True))


INTERPOLATIONS: dict[str, Interpolation] = {
    "latitude": _linear,
    "longitude": _longitude,
    "altitude": _linear,
    "heading": _bearing,
    "pitch": _turn,
    "roll": _turn,
    "sensor_angles": _each(_bearing, _turn, _bearing),
    "field_of_view": _each(_linear, _linear),
    "frame_centre": _position,
    "target": _position,
    "utc_ns": lambda a, b, share: a + round((b - a) * share),
    "ground_altitude": _linear,
}
