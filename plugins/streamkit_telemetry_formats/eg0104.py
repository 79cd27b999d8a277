"""MISB EG 0104: the older universal set ("Predator"), decoded to the tags of its successor, the local set.

The set has no checksum: it is valid if its elements fit into it. Sensor angles are left out, because they
refer to the horizon and not to the platform.

Source: MISB EG 0104.5, section 4; MISB ST 0601.12, section 8 (keys and types of the universal set).
"""

from __future__ import annotations

import struct

from streamkit_telemetry_formats.klv import BadKlv, universal_elements
from streamkit_telemetry_formats.st0601 import RAD, Decoder, LocalSet, Value, decode_tags, text, time


def real(low: float, high: float, scale: float = 1.0) -> Decoder:
    """A floating-point number of 4 or 8 bytes within low..high."""

    def decode(data: bytes) -> Value:
        if len(data) not in (4, 8):
            raise BadKlv(f"a floating-point number has 4 or 8 bytes, got {len(data)}")
        (number,) = struct.unpack(">f" if len(data) == 4 else ">d", data)
        if not low <= number <= high:  # false for NaN too
            raise BadKlv(f"a number must be {low:g} to {high:g}, got {number:g}")
        return float(number) * scale

    return decode


_LATITUDE, _LONGITUDE, _CIRCLE = real(-90, 90), real(-180, 180), real(-360, 360, RAD)
_HEIGHT, _FIELD = real(-1e5, 1e6), real(0, 180, RAD)

# Bytes 5 to 16 of the key without the registry's version (byte 8), to the tag of ST 0601 and its decoder.
ELEMENTS: dict[str, tuple[int, Decoder]] = {
    "010101 0702010101050000": (2, time(size=8)),
    "010101 0701100106000000": (5, _CIRCLE),
    "010101 0701100105000000": (6, _CIRCLE),
    "010101 0701100104000000": (7, _CIRCLE),
    "010101 0101200100000000": (10, text),
    "010101 0420010201010000": (11, text),
    "010101 0701010100000000": (12, text),
    "010101 0701020102040200": (13, _LATITUDE),
    "010101 0701020102060200": (14, _LONGITUDE),
    "010101 0701020102020000": (15, _HEIGHT),
    "010101 0420020101080000": (16, _FIELD),
    "010101 04200201010a0100": (17, _FIELD),
    "010101 0701080101000000": (21, real(0, 1e9)),
    "010101 0701090201000000": (22, real(0, 1e9)),
    "010101 0701020103020000": (23, _LATITUDE),
    "010101 0701020103040000": (24, _LONGITUDE),
    "010101 0701020103160000": (25, _HEIGHT),
    "010101 0701020103070100": (82, _LATITUDE),
    "010101 07010201030b0100": (83, _LONGITUDE),
    "010101 0701020103080100": (84, _LATITUDE),
    "010101 07010201030c0100": (85, _LONGITUDE),
    "010101 0701020103090100": (86, _LATITUDE),
    "010101 07010201030d0100": (87, _LONGITUDE),
    "010101 07010201030a0100": (88, _LATITUDE),
    "010101 07010201030e0100": (89, _LONGITUDE),
}
_BY_KEY = {bytes.fromhex(key): item for key, item in ELEMENTS.items()}


def decode_universal_set(value: bytes) -> LocalSet:
    """Decodes the value of a universal set.

    Raises:
        BadKlv: its elements do not fit into it.
    """
    found = ((_BY_KEY.get(key[4:7] + key[8:]), data) for key, data in universal_elements(value))
    return decode_tags((*known, data) for known, data in found if known is not None)
