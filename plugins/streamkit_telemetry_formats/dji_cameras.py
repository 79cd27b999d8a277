"""Fields of view of DJI cameras, for files that do not state them."""

from __future__ import annotations

import math
import re
from typing import Final

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
