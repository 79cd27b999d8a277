"""Position and attitude of a photograph, from the Exif and XMP data in its JPEG header."""

from __future__ import annotations

import io
import math
import re
from typing import Final

from PIL import Image

from streamkit_telemetry_formats.dji import (
    ABOVE_SEA,
    MAX_FIELD_OF_VIEW,
    attitude,
    camera_view,
    on_earth,
    orientation,
    take_off_altitude,
)
from streamkit_telemetry_formats.exif import ExifData, read_exif
from streamkit_telemetry_formats.sample import Sample

EXIF_ABOVE_SEA: Final = "exif above sea level"
EXIF: Final = "exif"
_DIAGONAL_35MM: Final = math.hypot(36.0, 24.0)
# An attribute or an element, as the writer pleased; the packet is searched, not parsed: it is untrusted and
# only a few numbers are needed.
_NUMBER: Final = rb"\s*[\"']?\s*([-+]?\d{1,12}(?:\.\d{1,20})?)\s*[\"'<]"
_FIELD: Final = re.compile(rb"drone-dji:(\w{1,40})\s*[=>]" + _NUMBER)


def sample_of_photograph(data: bytes, pts: int) -> Sample | None:
    """The pose of the camera and the time at which a photograph was taken.

    What a DJI aircraft writes as XMP goes before Exif: it has more digits and the attitude. The field of view
    is that published of the DJI camera, whose pictures of 16:9 are cut out of a sensor of another shape; else
    that of the focal length for 35 mm film, which counts along the diagonal, or of focal length and sensor.

    Returns:
        The sample, or None where the file has no position.

    Source: CIPA DC-008 (Exif 2.32); DJI's XMP name space `drone-dji`.
    """
    try:
        with Image.open(io.BytesIO(data), formats=("JPEG",)) as picture:
            size, info = picture.size, picture.info
    except Exception:  # Pillow raises of many kinds
        return None
    exif = read_exif(info.get("exif", b""))
    fields = read_fields(info.get("xmp", b""))
    longitude = fields.get("GpsLongitude", fields.get("GpsLongtitude"))  # as several models spell it
    place = on_earth(fields.get("GpsLatitude"), longitude) or exif.position
    if place is None:
        return None
    flight, gimbal = (
        attitude(fields, f"{body}PitchDegree", f"{body}RollDegree", f"{body}YawDegree")
        for body in ("Flight", "Gimbal")
    )
    altitude, source = exif.altitude, EXIF if exif.altitude is None else EXIF_ABOVE_SEA
    if "AbsoluteAltitude" in fields:
        altitude, source = fields["AbsoluteAltitude"], ABOVE_SEA
    return Sample(
        *place,
        pts=pts,
        altitude=altitude,
        **{"heading": exif.direction, **orientation(flight, gimbal)},
        field_of_view=_field_of_view(exif, size),
        utc_ns=exif.utc_ns,
        source=source,
        ground_altitude=take_off_altitude(fields, "AbsoluteAltitude", "RelativeAltitude"),
    )


def read_fields(packet: bytes) -> dict[str, float]:
    """The numbers of an XMP packet's name space `drone-dji` by name, such as `GimbalPitchDegree`."""
    return {name.decode("ascii", "replace"): float(number) for name, number in _FIELD.findall(packet)}


def _field_of_view(exif: ExifData, size: tuple[int, int]) -> tuple[float, float] | None:
    """Horizontal and vertical, rad."""
    if not min(size) > 0:
        return None
    view = camera_view(exif.model, size[0] / size[1])
    if view is None and exif.focal_35mm is None:
        view = exif.field_of_view
    if view is not None:
        half = math.tan(view / 2)
    elif exif.focal_35mm is not None and exif.focal_35mm > 0:
        half = _DIAGONAL_35MM / math.hypot(*size) * size[0] / (2 * exif.focal_35mm)
    else:
        return None
    across, down = 2 * math.atan(half), 2 * math.atan(half * size[1] / size[0])
    return (across, down) if across < MAX_FIELD_OF_VIEW else None
