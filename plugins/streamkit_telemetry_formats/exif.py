"""Position, time and focal length out of a photograph's Exif data."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Final

from streamkit.geometry.angles import wrap_bearing

Value = tuple[float, ...] | str

_ORDERS: Final = {b"II": "<", b"MM": ">"}
_MAGIC: Final = 42
_ENTRY_BYTES: Final = 12
_INLINE_BYTES: Final = 4
_MAX_VALUES: Final = 64
_ASCII: Final = 2
# How one value of each type is laid out; the types with two numbers are fractions.
_LAYOUTS: Final = {1: "B", 3: "H", 4: "I", 5: "II", 7: "B", 9: "i", 10: "ii", 11: "f", 12: "d"}
_FRACTIONS: Final = (5, 10)
_MODEL: Final = 0x0110
_EXIF_DIRECTORY: Final = 0x8769
_GPS_DIRECTORY: Final = 0x8825
_FOCAL_35MM: Final = 0xA405
_FOCAL_LENGTH, _PIXELS_ACROSS, _SENSOR_PER_UNIT, _SENSOR_UNIT = 0x920A, 0xA002, 0xA20E, 0xA210
_SENSOR_UNITS_MM: Final = {2: 25.4, 3: 10.0}
_LATITUDE, _LONGITUDE, _ALTITUDE_SIDE, _ALTITUDE = 2, 4, 5, 6
_TIME, _DATE, _DIRECTION_NORTH, _DIRECTION = 7, 29, 16, 17


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


def read_exif(tiff: bytes) -> ExifData:
    """Reads the TIFF structure of Exif data; what is missing or damaged in it stays None.

    Source: CIPA DC-008 (Exif 2.32), sections 4.6.5 and 4.6.6.
    """
    order = _ORDERS.get(tiff[:2])
    if order is None or len(tiff) < 8 or struct.unpack_from(f"{order}H", tiff, 2)[0] != _MAGIC:
        return ExifData()
    first = _directory(tiff, order, struct.unpack_from(f"{order}I", tiff, 4)[0])
    camera, gps = (
        _directory(tiff, order, int(_number(first, tag) or 0)) for tag in (_EXIF_DIRECTORY, _GPS_DIRECTORY)
    )
    latitude, longitude = _degrees(gps, _LATITUDE, "S", 90), _degrees(gps, _LONGITUDE, "W", 180)
    fix = None if latitude is None or longitude is None else (latitude, longitude)
    direction, altitude = _number(gps, _DIRECTION), _number(gps, _ALTITUDE)
    is_true = str(gps.get(_DIRECTION_NORTH, "T")).startswith("T")
    is_below = altitude is not None and _number(gps, _ALTITUDE_SIDE) == 1
    return ExifData(
        position=None if fix == (0.0, 0.0) else fix,
        altitude=-altitude if is_below and altitude else altitude,
        direction=None if direction is None or not is_true else wrap_bearing(math.radians(direction)),
        utc_ns=_utc_ns(gps),
        focal_35mm=_number(camera, _FOCAL_35MM) or None,
        field_of_view=_field_of_view(camera),
        model=str(first.get(_MODEL, "")),
    )


def _field_of_view(camera: dict[int, Value]) -> float | None:
    """Horizontal field of view, rad, by the focal length and the pixels of the sensor; None if unknown."""
    tags = _FOCAL_LENGTH, _PIXELS_ACROSS, _SENSOR_PER_UNIT
    focal_mm, pixels, per_unit = (_number(camera, tag) or 0.0 for tag in tags)
    unit_mm = _SENSOR_UNITS_MM.get(int(_number(camera, _SENSOR_UNIT) or 2), 0.0)
    if not min(focal_mm, pixels, per_unit, unit_mm) > 0:
        return None
    return 2 * math.atan(pixels / per_unit * unit_mm / (2 * focal_mm))


def _directory(tiff: bytes, order: str, offset: int) -> dict[int, Value]:
    """The entries of the directory at an offset by their tags; 0 is no directory."""
    if not 0 < offset <= len(tiff) - 2:
        return {}
    (count,) = struct.unpack_from(f"{order}H", tiff, offset)
    entries: dict[int, Value] = {}
    for place in range(offset + 2, offset + 2 + count * _ENTRY_BYTES, _ENTRY_BYTES):
        if place + _ENTRY_BYTES > len(tiff):
            break
        tag, kind, number = struct.unpack_from(f"{order}HHI", tiff, place)
        value = _value(tiff, order, kind, number, place + 8)
        if value is not None:
            entries[tag] = value
    return entries


def _value(tiff: bytes, order: str, kind: int, count: int, place: int) -> Value | None:
    """An entry's value, stored in the entry itself where it fits; None for unused types."""
    layout = "s" if kind == _ASCII else _LAYOUTS.get(kind)
    if layout is None or not 0 < count <= _MAX_VALUES:
        return None
    size = struct.calcsize(order + layout) * count
    if size > _INLINE_BYTES:
        (place,) = struct.unpack_from(f"{order}I", tiff, place)
    if place + size > len(tiff):
        return None
    if kind == _ASCII:
        return tiff[place : place + size].split(b"\0")[0].decode("ascii", "replace").strip()
    numbers = struct.unpack_from(order + layout * count, tiff, place)
    if kind not in _FRACTIONS:
        return tuple(float(number) for number in numbers)
    pairs = zip(numbers[::2], numbers[1::2], strict=True)
    return tuple(above / below if below else math.nan for above, below in pairs)


def _number(entries: dict[int, Value], tag: int) -> float | None:
    value = entries.get(tag)
    return value[0] if isinstance(value, tuple) and math.isfinite(value[0]) else None


def _degrees(gps: dict[int, Value], tag: int, negative: str, most: float) -> float | None:
    """Degrees, minutes and seconds as one number; the tag before has the hemisphere."""
    parts = gps.get(tag)
    if not isinstance(parts, tuple):
        return None
    degrees = sum(part * factor for part, factor in zip(parts, (1, 1 / 60, 1 / 3600), strict=False))
    if not 0 <= degrees <= most:
        return None
    return -degrees if str(gps.get(tag - 1, "")).upper().startswith(negative) else degrees


def _utc_ns(gps: dict[int, Value]) -> int | None:
    date, time = gps.get(_DATE), gps.get(_TIME)
    if not isinstance(date, str) or not isinstance(time, tuple) or len(time) != 3:
        return None
    try:
        day = datetime.strptime(date, "%Y:%m:%d").replace(tzinfo=UTC)
        passed = timedelta(hours=time[0], minutes=time[1], seconds=time[2])
    except (ValueError, OverflowError):
        return None
    return round((day + passed).timestamp() * 1e6) * 1000
