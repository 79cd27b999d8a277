"""Position and attitude of a photograph, from Exif and the XMP packet of DJI aircraft."""

from __future__ import annotations

import math
import re
from typing import Final

from streamkit_telemetry_formats.dji import ABOVE_SEA, Attitude, relative_angles
from streamkit_telemetry_formats.exif import ExifData, read_exif
from streamkit_telemetry_formats.jpeg import read_header
from streamkit_telemetry_formats.sample import Sample

EXIF_ABOVE_SEA: Final = "exif above sea level"
EXIF: Final = "exif"
_DIAGONAL_35MM: Final = math.hypot(36.0, 24.0)
_LONGITUDES: Final = ("GpsLongitude", "GpsLongtitude")  # the second is how several models spell it
_WIDEST: Final = math.radians(170)
# An attribute or an element, as the writer pleased; the packet is searched, not parsed: it is untrusted and
# only a few numbers are needed.
_NUMBER: Final = rb"\s*[\"']?\s*([-+]?\d{1,12}(?:\.\d{1,20})?)\s*[\"'<]"
_FIELD: Final = re.compile(rb"drone-dji:(\w{1,40})\s*[=>]" + _NUMBER)


def sample_of_photograph(data: bytes, pts: int) -> Sample | None:
    """Where and how a photograph was taken.

    What a DJI aircraft writes as XMP goes before Exif: it has more digits and the attitude. The field of view
    is that of the focal length for 35 mm film, which counts along the diagonal.

    Args:
        data: the JPEG file.
        pts: of the image, ns.

    Returns:
        The sample, or None where the file has no position.

    Source: CIPA DC-008 (Exif 2.32); DJI's XMP name space `drone-dji`.
    """
    header = read_header(data)
    exif = read_exif(header.exif)
    fields = read_fields(header.xmp)
    place = _place(fields) or exif.position
    if place is None:
        return None
    flight, gimbal = _attitude(fields, "Flight"), _attitude(fields, "Gimbal")
    altitude, source = _altitude(fields, exif)
    return Sample(
        pts,
        *place,
        altitude=altitude,
        heading=flight[2] % (2 * math.pi) if flight is not None else exif.direction,
        pitch=flight[0] if flight is not None else None,
        roll=flight[1] if flight is not None else None,
        sensor_angles=relative_angles(flight or (0.0, 0.0, 0.0), gimbal) if gimbal is not None else None,
        field_of_view=_field_of_view(exif.focal_35mm, header.size),
        utc_ns=exif.utc_ns,
        source=source,
    )


def read_fields(packet: bytes) -> dict[str, float]:
    """The numbers of the name space `drone-dji` by their names, such as `GimbalPitchDegree`.

    Args:
        packet: the XMP packet, UTF-8.
    """
    return {name.decode("ascii", "replace"): float(number) for name, number in _FIELD.findall(packet)}


def _place(fields: dict[str, float]) -> tuple[float, float] | None:
    latitude = fields.get("GpsLatitude")
    longitude = next((fields[name] for name in _LONGITUDES if name in fields), None)
    if latitude is None or longitude is None or (latitude, longitude) == (0.0, 0.0):
        return None
    return (latitude, longitude) if abs(latitude) <= 90 and abs(longitude) <= 180 else None


def _altitude(fields: dict[str, float], exif: ExifData) -> tuple[float | None, str]:
    if "AbsoluteAltitude" in fields:
        return fields["AbsoluteAltitude"], ABOVE_SEA
    return exif.altitude, EXIF if exif.altitude is None else EXIF_ABOVE_SEA


def _attitude(fields: dict[str, float], body: str) -> Attitude | None:
    """Pitch, roll and yaw of the aircraft or its gimbal against horizon and north, rad."""
    names = [f"{body}{axis}Degree" for axis in ("Pitch", "Roll", "Yaw")]
    if not all(name in fields for name in names):
        return None
    pitch, roll, yaw = (math.radians(fields[name]) for name in names)
    return pitch, roll, yaw


def _field_of_view(focal_35mm: float | None, size: tuple[int, int] | None) -> tuple[float, float] | None:
    """Horizontal and vertical, rad."""
    if focal_35mm is None or size is None or not min(size) > 0 or not focal_35mm > 0:
        return None
    per_px = _DIAGONAL_35MM / math.hypot(*size)
    across, down = (2 * math.atan(side * per_px / (2 * focal_35mm)) for side in size)
    return (across, down) if across < _WIDEST else None
