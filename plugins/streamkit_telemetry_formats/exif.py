"""Position, time and focal length out of a photograph's Exif data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from numbers import Real
from typing import Any

from PIL import Image
from PIL.ExifTags import GPS, IFD, Base

from streamkit.geometry.angles import wrap_bearing

Entries = Mapping[int, Any]
SENSOR_UNITS_MM = {2: 25.4, 3: 10.0}


@dataclass(frozen=True, slots=True)
class ExifData:
    """Exif data of a photograph."""

    position: tuple[float, float] | None = None  # latitude and longitude, deg, WGS84
    altitude: float | None = None  # m above sea level
    direction: float | None = None  # the way the camera looked, rad clockwise from true north
    utc_ns: int | None = None  # when, by the satellites' clock
    focal_35mm: float | None = None  # focal length that gives the same diagonal view on 36 x 24 mm, mm
    field_of_view: float | None = None  # horizontal, by focal length and size of the sensor, rad
    model: str = ""  # of the camera; empty if unknown


def read_exif(data: bytes) -> ExifData:
    """Reads Exif data, a TIFF structure; damaged data have no values.

    Source: CIPA DC-008 (Exif 2.32), sections 4.6.5 and 4.6.6.
    """
    exif = Image.Exif()
    try:
        exif.load(data)
        camera, gps, model = exif.get_ifd(IFD.Exif), exif.get_ifd(IFD.GPSInfo), exif.get(Base.Model, "")
    except Exception:  # Pillow raises of many kinds
        return ExifData()
    latitude, longitude = _degrees(gps, GPS.GPSLatitude, "S", 90), _degrees(gps, GPS.GPSLongitude, "W", 180)
    fix = None if latitude is None or longitude is None else (latitude, longitude)
    direction, altitude = _number(gps, GPS.GPSImgDirection), _number(gps, GPS.GPSAltitude)
    is_true = str(gps.get(GPS.GPSImgDirectionRef, "T")).startswith("T")
    is_below = altitude is not None and _number(gps, GPS.GPSAltitudeRef) == 1
    return ExifData(
        position=None if fix == (0.0, 0.0) else fix,
        altitude=-altitude if is_below and altitude else altitude,
        direction=None if direction is None or not is_true else wrap_bearing(math.radians(direction)),
        utc_ns=_utc_ns(gps),
        focal_35mm=_number(camera, Base.FocalLengthIn35mmFilm) or None,
        field_of_view=_field_of_view(camera),
        model=str(model),
    )


def _field_of_view(camera: Entries) -> float | None:
    """Horizontal field of view, rad, by the focal length and the pixels of the sensor; None if unknown."""
    tags = Base.FocalLength, Base.ExifImageWidth, Base.FocalPlaneXResolution
    focal_mm, pixels, per_unit = (_number(camera, tag) or 0.0 for tag in tags)
    unit_mm = SENSOR_UNITS_MM.get(int(_number(camera, Base.FocalPlaneResolutionUnit) or 2), 0.0)
    if not min(focal_mm, pixels, per_unit, unit_mm) > 0:
        return None
    return 2 * math.atan(pixels / per_unit * unit_mm / (2 * focal_mm))


def _number(entries: Entries, tag: int) -> float | None:
    value = entries.get(tag)
    first = value[0] if isinstance(value, tuple | bytes) and value else value
    return float(first) if isinstance(first, Real) and math.isfinite(first) else None


def _degrees(gps: Entries, tag: int, negative: str, most: float) -> float | None:
    """Degrees, minutes and seconds as one number; the tag before has the hemisphere."""
    parts = gps.get(tag)
    if not isinstance(parts, tuple) or not all(isinstance(part, Real) for part in parts):
        return None
    degrees = sum(float(part) * factor for part, factor in zip(parts, (1, 1 / 60, 1 / 3600), strict=False))
    if not 0 <= degrees <= most:
        return None
    return -degrees if str(gps.get(tag - 1, "")).upper().startswith(negative) else degrees


def _utc_ns(gps: Entries) -> int | None:
    date, time = gps.get(GPS.GPSDateStamp), gps.get(GPS.GPSTimeStamp)
    try:
        day = datetime.strptime(str(date), "%Y:%m:%d").replace(tzinfo=UTC)
        hours, minutes, seconds = map(float, time or ())
        passed = timedelta(hours=hours, minutes=minutes, seconds=seconds)
    except (TypeError, ValueError, OverflowError):
        return None
    return round((day + passed).timestamp() * 1e6) * 1000
