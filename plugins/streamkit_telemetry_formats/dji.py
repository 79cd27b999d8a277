"""Samples of telemetry out of the subtitles that DJI aircraft write: every dialect from Mavic Pro on.

    [latitude: 41.42] [longitude: 2.23] [altitude: 117.0]                   Air 2S, Mavic 2 and 3
    [rel_alt: 1.300 abs_alt: 85.013] [gb_yaw: 9.7 gb_pitch: -24.2 gb_roll: 0.0]
    GPS(149.0251,-20.2533,16) BAROMETER:1.9                                 longitude, latitude, satellites
    GPS(36.6146,-6.1120,0.0M) BAROMETER:0.3M                                latitude, longitude, altitude
    GPS (-58.85, -34.23, 15), H 85.80m, F.PRY (2.7, -7.0, 110.1), G.PRY (-24.4, 0.0, 110.4)
    GPS(149.0251,-20.2533,16) Hb:1.9 Hs:0.0                                 barometer, sonar; the oldest
    [focal_len : 240] [dzoom_ratio: 10000, delta:0], or [focal_len: 24.00] [dzoom_ratio: 1.00]

Heights are above the take-off point where the text has no other; the sample's source says which.
The dialects with local time have no time zone, so there is no UTC.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

import numpy as np

from streamkit.geometry.angles import wrap_bearing
from streamkit.geometry.camera import rotation_matrix
from streamkit_telemetry_formats.sample import Sample
from streamkit_telemetry_formats.subrip import AircraftClock, SubtitleReader

_WIDE, _LONG = 4 / 3, 3 / 2
# Diagonal field of view, deg, and width by height of the sensor, by models and the codes of their cameras in
# Exif data. Those that zoom are not here.
_CAMERAS: Final[dict[str, tuple[float, float]]] = {
    name: (view, aspect)
    for names, view, aspect in (
        ("inspire1 fc350 phantom3pro fc300x phantom3advanced fc300s phantom4 fc330", 94.0, _WIDE),
        ("phantom4pro fc6310 phantom4prov2 fc6310s phantom4rtk fc6310r zenmusex4s fc6510", 84.0, _LONG),
        ("phantom4multispectral fc6360", 62.7, _WIDE),
        ("spark fc1102", 81.9, _WIDE),
        ("mavicpro fc220", 78.8, _WIDE),
        ("mavic2pro l1d20c", 77.0, _LONG),
        ("mavic3 l2d20c mavic3enterprise m3e", 84.0, _WIDE),
        ("mavicair fc2103", 85.0, _WIDE),
        ("mavicair2 fc3170", 84.0, _WIDE),
        ("air2s fc3411", 88.0, _LONG),
        ("air3 fc8282", 82.0, _WIDE),
        ("mavicmini fc7203 minise mini2 fc7303 mini2se fc7503", 83.0, _WIDE),
        ("mini3 fc3682 mini3pro fc3582 mini4pro fc8482", 82.1, _WIDE),
    )
    for name in names.split()
}
# No more digits than a quantity has: a longer row of them is damage, and would be infinite as a number.
NUMBER = r"([-+]?\d{1,9}(?:\.\d{1,20})?)(?!\d)"
FIELD = re.compile(rf"\b([a-zA-Z_]+)\s*:\s*{NUMBER}(?=m?(?![\w.]))")
GPS = re.compile(rf"GPS\s*\(\s*{NUMBER}\s*,\s*{NUMBER}\s*,\s*{NUMBER}\s*(M?)\s*\)")
HEIGHT = re.compile(rf"(?:\bH\s+|BAROMETER\s*:\s*){NUMBER}\s*m?", re.IGNORECASE)
ANGLES = re.compile(rf"([FG])\.PRY\s*\(\s*{NUMBER}°?\s*,\s*{NUMBER}°?\s*,\s*{NUMBER}°?\s*\)")
FOCAL = re.compile(r"\bfocal_len\s*:\s*(\d{1,6}(?:\.\d{1,6})?)(?![\w.])")
ZOOM = re.compile(r"\bdzoom_ratio\s*:\s*(\d{1,6}(?:\.\d{1,6})?)(?![\w.])")
POSITION = re.compile(r"\bGPS\s*\(|\b(?:latitude|longt?itude)\b", re.IGNORECASE)
NO_FIX = re.compile(
    r"n/a|\(\s*[-+]?0[.0]*\s*,\s*[-+]?0[.0]*\s*,|latitude\s*:\s*[-+]?0[.0]*[\s\]]", re.IGNORECASE
)
ABOVE_TAKE_OFF, ABOVE_SEA, UNKNOWN_HEIGHT = "dji above take-off", "dji above sea level", "dji"
ABOVE_GROUND = "dji above ground"
# Fields with a height, the first there is counts; "height" stands for what HEIGHT finds.
HEIGHTS = (
    ("abs_alt", ABOVE_SEA), ("rel_alt", ABOVE_TAKE_OFF), ("altitude", UNKNOWN_HEIGHT),
    ("height", ABOVE_TAKE_OFF), ("hb", ABOVE_TAKE_OFF), ("hs", ABOVE_GROUND),
)  # fmt: skip
MAX_FIELD_OF_VIEW = math.radians(170)
Attitude = tuple[float, float, float]


def camera_view(model: str, aspect: float = 16 / 9) -> float | None:
    """Horizontal field of view, rad, of an aircraft or camera; None for an unknown one.

    A frame wider than the sensor shows its full width, a narrower one its full height. Modes that crop the
    sensor further are not taken into account.

    Args:
        model: such as `DJI Mini 2`, `mini-2`, or `FC7303`.
        aspect: width of the frame by its height.

    Source: the specifications of each model (Camera: lens, field of view; sensor) that DJI publishes.
    """
    known = _CAMERAS.get(re.sub(r"[^a-z0-9]|^dji", "", model.lower()))
    return None if known is None else _horizontal(math.tan(math.radians(known[0]) / 2), known[1], aspect)


def focal_view(focal_35mm: float) -> float:
    """Horizontal field of view of a 16:9 frame, rad, by the focal length for 35 mm film, mm.

    It is meant for the diagonal of a 4:3 sensor.
    """
    return _horizontal(math.hypot(36.0, 24.0) / (2 * focal_35mm), _WIDE, 16 / 9)


def _horizontal(half_diagonal: float, sensor: float, aspect: float) -> float:
    """By the tangent of half the diagonal view; `sensor` and `aspect` are widths by heights."""
    half = half_diagonal * sensor / math.hypot(sensor, 1.0)
    return 2 * math.atan(half * min(1.0, aspect / sensor))


class DjiTelemetry:
    """Subtitles to samples."""

    def __init__(self) -> None:
        self.subtitles = 0  # seen
        self.poses = 0  # of them, those that gave a sample
        self._unreadable = 0
        self._reader = SubtitleReader()
        self._clock = AircraftClock()

    @property
    def broken(self) -> int:
        """Subtitles whose times or position cannot be read."""
        return self._unreadable + self._reader.broken

    def read(self, lines: Iterable[str]) -> Iterator[Sample]:
        """The samples of a file's lines; subtitles without a position are skipped."""
        for own_begin, text in self._reader.cues(lines):
            begin = self._clock.begin_ns(text, own_begin)
            if begin is None:
                self.subtitles += 1
                self._unreadable += 1
            elif (sample := self.sample(text, begin)) is not None:
                yield sample

    def sample(self, text: str, pts: int) -> Sample | None:
        """The sample of one subtitle; None without a valid position."""
        self.subtitles += 1
        sample = sample_of(text, pts)
        if sample is not None:
            self.poses += 1
        elif POSITION.search(text) and not NO_FIX.search(text):
            self._unreadable += 1
        return sample


def sample_of(text: str, pts: int) -> Sample | None:
    """The sample of one subtitle's text, shown first at `pts` ns; None without a valid position."""
    fields = {name.lower(): float(value) for name, value in FIELD.findall(text)}
    place = _place(text, fields)
    if place is None:
        return None
    altitude, source = _altitude(text, fields)
    for body, *angles in ANGLES.findall(text):
        fields |= {f"{body}{axis}": float(angle) for axis, angle in zip("PRY", angles, strict=True)}
    flight = attitude(fields, "FP", "FR", "FY")
    gimbal = attitude(fields, "GP", "GR", "GY") or attitude(fields, "gb_pitch", "gb_roll", "gb_yaw")
    # The ground is taken to be as high as the take-off.
    is_above_ground = source in (ABOVE_TAKE_OFF, ABOVE_GROUND)
    return Sample(
        *place,
        pts=pts,
        altitude=altitude,
        **orientation(flight, gimbal),
        field_of_view=_field_of_view(text),
        source=source,
        ground_altitude=0.0 if is_above_ground else take_off_altitude(fields, "abs_alt", "rel_alt"),
    )


def orientation(flight: Attitude | None, gimbal: Attitude | None) -> dict[str, Any]:
    """The fields of a sample for the attitudes of aircraft and gimbal, as far as they are known."""
    found: dict[str, Any] = {}
    if flight is not None:
        found = {"heading": wrap_bearing(flight[2]), "pitch": flight[0], "roll": flight[1]}
    if gimbal is not None:
        found["sensor_angles"] = relative_angles(flight or (0.0, 0.0, 0.0), gimbal)
    return found


def _field_of_view(text: str) -> tuple[float, float] | None:
    """Horizontal and vertical, rad, of a frame of 16:9, by the focal length for 35 mm film; or None."""
    focal_mm, zoom = _in_units(FOCAL.search(text), 0.1), _in_units(ZOOM.search(text), 1e-4) or 1.0
    across = focal_view(focal_mm * zoom) if focal_mm else math.pi
    return (across, 2 * math.atan(math.tan(across / 2) * 9 / 16)) if across < MAX_FIELD_OF_VIEW else None


def _in_units(found: re.Match[str] | None, unit: float) -> float:
    """The number found, in units of `unit` where it has no point, as older models write it; 0 for None."""
    return 0.0 if found is None else float(found[1]) * (1.0 if "." in found[1] else unit)


def take_off_altitude(fields: Mapping[str, float], absolute: str, relative: str) -> float | None:
    """Altitude of the take-off, m, of fields with these names; None where one is missing."""
    return fields[absolute] - fields[relative] if {absolute, relative} <= fields.keys() else None


def relative_angles(platform: Attitude, sensor: Attitude) -> Attitude:
    """Azimuth, elevation and roll of a sensor relative to its platform, rad.

    Args:
        platform: pitch, roll, yaw, rad relative to horizon and north, as DJI writes them.
        sensor: the same.
    """
    from_platform, from_sensor = (
        rotation_matrix(yaw, pitch, roll) for pitch, roll, yaw in (platform, sensor)
    )
    turned = from_platform.T @ from_sensor
    elevation = math.asin(float(np.clip(-turned[2, 0], -1, 1)))
    if abs(turned[2, 0]) > 1 - 1e-9:  # straight up or down: azimuth and roll are one angle, called azimuth
        return wrap_bearing(math.atan2(-turned[0, 1], turned[1, 1])), elevation, 0.0
    azimuth, roll = math.atan2(turned[1, 0], turned[0, 0]), math.atan2(turned[2, 1], turned[2, 2])
    return wrap_bearing(azimuth), elevation, wrap_bearing(roll)


def _place(text: str, fields: dict[str, float]) -> tuple[float, float] | None:
    longitude = fields.get("longitude", fields.get("longtitude"))  # as several models spell it
    if "latitude" in fields and longitude is not None:
        return on_earth(fields["latitude"], longitude)
    found = GPS.search(text)
    if found is None:
        return None
    first, second = float(found[1]), float(found[2])
    # The models that give an altitude in metres as third number have the latitude first.
    return on_earth(first, second) if found[4] else on_earth(second, first)


def on_earth(latitude: float | None, longitude: float | None) -> tuple[float, float] | None:
    """A position, deg; None where there is none, or no fix: without one the aircraft writes zeros."""
    if latitude is None or longitude is None or (latitude, longitude) == (0.0, 0.0):
        return None
    return (latitude, longitude) if abs(latitude) <= 90 and abs(longitude) <= 180 else None


def _altitude(text: str, fields: dict[str, float]) -> tuple[float | None, str]:
    if (height := HEIGHT.search(text)) is not None:
        fields = {"height": float(height[1]), **fields}
    return next(
        ((fields[name], source) for name, source in HEIGHTS if name in fields), (None, UNKNOWN_HEIGHT)
    )


def attitude(fields: Mapping[str, float], pitch: str, roll: str, yaw: str) -> Attitude | None:
    """The attitude of fields with these names, in degrees, as rad; None where one is missing."""
    found = [math.radians(fields[name]) for name in (pitch, roll, yaw) if name in fields]
    return (found[0], found[1], found[2]) if len(found) == 3 else None
