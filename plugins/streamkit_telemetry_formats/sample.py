"""One sample of telemetry, whatever it was sent as, and the sample between two."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any

from streamkit.geometry.angles import wrap_bearing, wrap_turn
from streamkit.geometry.pose import Pose

Position = tuple[float, float, float | None]
# What a value is between two of them, at a share of the way.
Interpolation = Callable[[Any, Any, float], Any]


@dataclass(frozen=True, slots=True)
class Sample(Pose):
    """Where the camera was and what it saw at one moment; the gap is that of a frame, here 0.

    Attributes:
        pts: on the video's line of time, ns.
        target: latitude, longitude (deg) and elevation (m) of the target.
        utc_ns: when, by the platform's clock.
    """

    pts: int = field(kw_only=True)
    target: Position | None = None
    utc_ns: int | None = None

    @property
    def pose(self) -> Pose:
        """The pose alone, without time and target."""
        return Pose(*(getattr(self, part.name) for part in fields(Pose)))


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
