"""MISB ST 0601: decodes the tags of a UAS local set to SI units.

Angles are rad except latitudes and longitudes, which stay deg (WGS84); pressures Pa, temperatures deg C,
altitudes and distances m, speeds m/s, times UTC ns.

Source: MISB ST 0601 (integer mappings of tags 2 to 93), ST 1201 (IMAPB).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from streamkit_telemetry_formats.klv import BadKlv, elements

Value = int | float | str | bytes | None
Decoder = Callable[[bytes], Value]
LONGEST_TEXT = 4096
LATEST_TIME_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class St0601Tag:
    """One element of the local set.

    Attributes:
        name: as in the standard.
        unit: of the decoded value, or "".
        decode: bytes to value; None is the standard's "out of range" or "error".
    """

    name: str
    unit: str
    decode: Decoder


def unsigned(
    low: float = 0.0, high: float | None = None, size: int = 0, scale: float = 1.0, most: int = 8
) -> Decoder:
    """An unsigned integer, unscaled or mapped linearly onto low..high; `size` bytes, 0 for one to `most`."""

    def decode(data: bytes) -> Value:
        _check_size(data, size, most)
        number = int.from_bytes(data, "big")
        if high is None:
            return number if scale == 1.0 else number * scale
        return (number * (high - low) / ((1 << 8 * len(data)) - 1) + low) * scale

    return decode


def signed(bound: float | None = None, size: int = 0, scale: float = 1.0, most: int = 8) -> Decoder:
    """A signed integer, unscaled or mapped onto -bound..bound; the lowest number then means "no value"."""

    def decode(data: bytes) -> Value:
        _check_size(data, size, most)
        number = int.from_bytes(data, "big", signed=True)
        if bound is None:
            return number if scale == 1.0 else number * scale
        largest = (1 << 8 * len(data) - 1) - 1
        return None if number < -largest else number * bound / largest * scale

    return decode


def time(size: int = 0) -> Decoder:
    """Microseconds since 1970 as ns; times after the year 2262 do not fit into 64 bits and are refused."""
    microseconds = unsigned(size=size)

    def decode(data: bytes) -> Value:
        number = microseconds(data)
        assert isinstance(number, int)
        if number > LATEST_TIME_NS // 1000:
            raise BadKlv(f"a time must be before the year 2263, got {number} us")
        return number * 1000

    return decode


def imapb(low: float, high: float, scale: float = 1.0, most: int = 8) -> Decoder:
    """A floating-point number mapped onto an integer of one to `most` bytes (ST 1201)."""

    def decode(data: bytes) -> Value:
        _check_size(data, 0, most)
        number = int.from_bytes(data, "big")
        span_bits, data_bits = math.ceil(math.log2(high - low)), 8 * len(data) - 1
        forward = 2.0 ** (data_bits - span_bits)
        offset = forward * low - math.floor(forward * low) if low < 0 < high else 0.0
        # The highest bit alone is the upper end; with other bits set it codes infinities and NaN.
        value = (number - offset) / forward + low
        return None if number > 1 << data_bits or value > high else value * scale

    return decode


def text(data: bytes) -> Value:
    """Text in UTF-8; invalid bytes become replacement characters."""
    if len(data) > LONGEST_TEXT:
        raise BadKlv(f"a text has at most {LONGEST_TEXT} bytes, got {len(data)}")
    return data.decode("utf-8", "replace").rstrip("\0")


def nested(data: bytes) -> Value:
    """A nested set or pack, left as bytes."""
    return data


def _check_size(data: bytes, size: int, most: int = 8) -> None:
    if not data or len(data) > (size or most) or (size and len(data) != size):
        raise BadKlv(f"a value must have {size or f'1 to {most}'} bytes, got {len(data)}")


RAD = math.pi / 180
HPA = 100.0

_LATITUDE, _LONGITUDE = signed(90, 4), signed(180, 4)
_ALTITUDE = unsigned(-900, 19_000, 2)
_HEIGHT = imapb(-900, 40_000)
_OFFSET = signed(0.075, 2)
_CIRCLE = unsigned(0, 360, 2, RAD)
_TIME = time(size=8)
_AXES = "Latitude", "Longitude"
_BYTE, _WORD = unsigned(size=1), unsigned(size=2)

# Tags without a unit: nested sets and packs, texts, and numbers of one byte.
_NESTED = {
    48: "Security Local Set", 66: "Target Location Covariance Matrix", 73: "RVT Local Set",
    74: "VMTI Local Set", 81: "Image Horizon Pixel Pack", 94: "MIIS Core Identifier",
    95: "SAR Motion Imagery Local Set", 97: "Range Image Local Set", 98: "Geo-Registration Local Set",
    99: "Composite Imaging Local Set", 100: "Segment Local Set", 101: "Amend Local Set", 102: "SDCC-FLP",
    115: "Control Command", 116: "Control Command Verification List", 121: "Active Wavelength List",
    122: "Country Codes", 127: "Sensor Frame Rate Pack", 128: "Wavelengths List", 130: "Airbase Locations",
    138: "Payload List", 139: "Active Payloads", 140: "Weapons Stores", 141: "Waypoint List",
    142: "View Domain", 143: "Metadata Substream ID Pack",
}  # fmt: skip
_TEXTS = {
    3: "Mission ID", 4: "Platform Tail Number", 10: "Platform Designation", 11: "Image Source Sensor",
    12: "Image Coordinate System", 59: "Platform Call Sign", 70: "Alternate Platform Name",
    106: "Stream Designator", 107: "Operational Base", 108: "Broadcast Source", 129: "Target ID",
    135: "Communications Method",
}  # fmt: skip
_BYTES = {
    34: "Icing Detected", 47: "Generic Flag Data", 61: "Weapon Fired", 63: "Sensor Field of View Name",
    65: "UAS Datalink LS Version Number", 77: "Operational Mode", 123: "Number of NAVSATs in View",
    124: "Positioning Method Source", 125: "Platform Status", 126: "Sensor Control Mode",
}  # fmt: skip

TAGS: dict[int, St0601Tag] = {
    **{tag: St0601Tag(name, "", nested) for tag, name in _NESTED.items()},
    **{tag: St0601Tag(name, "", text) for tag, name in _TEXTS.items()},
    **{tag: St0601Tag(name, "", _BYTE) for tag, name in _BYTES.items()},
    **{
        26 + i: St0601Tag(f"Offset Corner {_AXES[i % 2]} Point {i // 2 + 1}", "deg", _OFFSET)
        for i in range(8)
    },
    **{
        82 + i: St0601Tag(
            f"Corner {_AXES[i % 2]} Point {i // 2 + 1} (Full)", "deg", (_LATITUDE, _LONGITUDE)[i % 2]
        )
        for i in range(8)
    },
    1: St0601Tag("Checksum", "", unsigned(size=2)),
    2: St0601Tag("Precision Time Stamp", "ns", _TIME),
    5: St0601Tag("Platform Heading Angle", "rad", _CIRCLE),
    6: St0601Tag("Platform Pitch Angle", "rad", signed(20, 2, RAD)),
    7: St0601Tag("Platform Roll Angle", "rad", signed(50, 2, RAD)),
    8: St0601Tag("Platform True Airspeed", "m/s", _BYTE),
    9: St0601Tag("Platform Indicated Airspeed", "m/s", _BYTE),
    13: St0601Tag("Sensor Latitude", "deg", _LATITUDE),
    14: St0601Tag("Sensor Longitude", "deg", _LONGITUDE),
    15: St0601Tag("Sensor True Altitude", "m", _ALTITUDE),
    16: St0601Tag("Sensor Horizontal Field of View", "rad", unsigned(0, 180, 2, RAD)),
    17: St0601Tag("Sensor Vertical Field of View", "rad", unsigned(0, 180, 2, RAD)),
    18: St0601Tag("Sensor Relative Azimuth Angle", "rad", unsigned(0, 360, 4, RAD)),
    19: St0601Tag("Sensor Relative Elevation Angle", "rad", signed(180, 4, RAD)),
    20: St0601Tag("Sensor Relative Roll Angle", "rad", unsigned(0, 360, 4, RAD)),
    21: St0601Tag("Slant Range", "m", unsigned(0, 5_000_000, 4)),
    22: St0601Tag("Target Width", "m", unsigned(0, 10_000, 2)),
    23: St0601Tag("Frame Center Latitude", "deg", _LATITUDE),
    24: St0601Tag("Frame Center Longitude", "deg", _LONGITUDE),
    25: St0601Tag("Frame Center Elevation", "m", _ALTITUDE),
    35: St0601Tag("Wind Direction", "rad", _CIRCLE),
    36: St0601Tag("Wind Speed", "m/s", unsigned(0, 100, 1)),
    37: St0601Tag("Static Pressure", "Pa", unsigned(0, 5000, 2, HPA)),
    38: St0601Tag("Density Altitude", "m", _ALTITUDE),
    39: St0601Tag("Outside Air Temperature", "deg C", signed(size=1)),
    40: St0601Tag("Target Location Latitude", "deg", _LATITUDE),
    41: St0601Tag("Target Location Longitude", "deg", _LONGITUDE),
    42: St0601Tag("Target Location Elevation", "m", _ALTITUDE),
    43: St0601Tag("Target Track Gate Width", "px", unsigned(size=1, scale=2)),
    44: St0601Tag("Target Track Gate Height", "px", unsigned(size=1, scale=2)),
    45: St0601Tag("Target Error Estimate CE90", "m", unsigned(0, 4095, 2)),
    46: St0601Tag("Target Error Estimate LE90", "m", unsigned(0, 4095, 2)),
    49: St0601Tag("Differential Pressure", "Pa", unsigned(0, 5000, 2, HPA)),
    50: St0601Tag("Platform Angle of Attack", "rad", signed(20, 2, RAD)),
    51: St0601Tag("Platform Vertical Speed", "m/s", signed(180, 2)),
    52: St0601Tag("Platform Sideslip Angle", "rad", signed(20, 2, RAD)),
    53: St0601Tag("Airfield Barometric Pressure", "Pa", unsigned(0, 5000, 2, HPA)),
    54: St0601Tag("Airfield Elevation", "m", _ALTITUDE),
    55: St0601Tag("Relative Humidity", "%", unsigned(0, 100, 1)),
    56: St0601Tag("Platform Ground Speed", "m/s", _BYTE),
    57: St0601Tag("Ground Range", "m", unsigned(0, 5_000_000, 4)),
    58: St0601Tag("Platform Fuel Remaining", "kg", unsigned(0, 10_000, 2)),
    60: St0601Tag("Weapon Load", "", _WORD),
    62: St0601Tag("Laser PRF Code", "", _WORD),
    64: St0601Tag("Platform Magnetic Heading", "rad", _CIRCLE),
    67: St0601Tag("Alternate Platform Latitude", "deg", _LATITUDE),
    68: St0601Tag("Alternate Platform Longitude", "deg", _LONGITUDE),
    69: St0601Tag("Alternate Platform Altitude", "m", _ALTITUDE),
    71: St0601Tag("Alternate Platform Heading", "rad", _CIRCLE),
    72: St0601Tag("Event Start Time", "ns", _TIME),
    75: St0601Tag("Sensor Ellipsoid Height", "m", _ALTITUDE),
    76: St0601Tag("Alternate Platform Ellipsoid Height", "m", _ALTITUDE),
    78: St0601Tag("Frame Center Height Above Ellipsoid", "m", _ALTITUDE),
    79: St0601Tag("Sensor North Velocity", "m/s", signed(327, 2)),
    80: St0601Tag("Sensor East Velocity", "m/s", signed(327, 2)),
    90: St0601Tag("Platform Pitch Angle (Full)", "rad", signed(90, 4, RAD)),
    91: St0601Tag("Platform Roll Angle (Full)", "rad", signed(90, 4, RAD)),
    92: St0601Tag("Platform Angle of Attack (Full)", "rad", signed(90, 4, RAD)),
    93: St0601Tag("Platform Sideslip Angle (Full)", "rad", signed(180, 4, RAD)),
    96: St0601Tag("Target Width Extended", "m", imapb(0, 1_500_000)),
    103: St0601Tag("Density Altitude Extended", "m", _HEIGHT),
    104: St0601Tag("Sensor Ellipsoid Height Extended", "m", _HEIGHT),
    105: St0601Tag("Alternate Platform Ellipsoid Height Extended", "m", _HEIGHT),
    109: St0601Tag("Range To Recovery Location", "m", imapb(0, 21_000, 1000, most=4)),
    110: St0601Tag("Time Airborne", "s", unsigned(most=4)),
    111: St0601Tag("Propulsion Unit Speed", "1/min", unsigned(most=4)),
    112: St0601Tag("Platform Course Angle", "rad", imapb(0, 360, RAD)),
    113: St0601Tag("Altitude Above Ground Level", "m", _HEIGHT),
    114: St0601Tag("Radar Altimeter", "m", _HEIGHT),
    117: St0601Tag("Sensor Azimuth Rate", "rad/s", imapb(-1000, 1000, RAD, most=4)),
    118: St0601Tag("Sensor Elevation Rate", "rad/s", imapb(-1000, 1000, RAD, most=4)),
    119: St0601Tag("Sensor Roll Rate", "rad/s", imapb(-1000, 1000, RAD, most=4)),
    120: St0601Tag("On-board MI Storage Percent Full", "%", imapb(0, 100, most=4)),
    131: St0601Tag("Take-off Time", "ns", time()),
    132: St0601Tag("Transmission Frequency", "Hz", imapb(1, 99_999, 1e6, most=4)),
    133: St0601Tag("On-board MI Storage Capacity", "GB", unsigned(most=4)),
    134: St0601Tag("Zoom Percentage", "%", imapb(0, 100, most=4)),
    136: St0601Tag("Leap Seconds", "s", signed(most=4)),
    137: St0601Tag("Correction Offset", "ns", signed(scale=1000)),
}


@dataclass(frozen=True, slots=True)
class LocalSet:
    """A decoded UAS local set.

    Attributes:
        values: by tag, in the units of `TAGS`; "no value" and unknown tags are left out.
        unknown: tags that are not in `TAGS`.
        broken: tags whose bytes violate the standard; their values are left out.
    """

    values: dict[int, int | float | str | bytes]
    unknown: tuple[int, ...] = ()
    broken: tuple[int, ...] = ()


def decode_local_set(value: bytes) -> LocalSet:
    """Decodes the value of a UAS local set whose checksum is correct.

    Raises:
        BadKlv: its elements do not fit into it.
    """
    found = ((number, TAGS.get(number), data) for number, data in elements(value))
    return decode_tags((number, None if tag is None else tag.decode, data) for number, tag, data in found)


def decode_tags(items: Iterable[tuple[int, Decoder | None, bytes]]) -> LocalSet:
    """The set of these tags with their decoders, None of an unknown tag; of equal tags the last counts."""
    values: dict[int, int | float | str | bytes] = {}
    unknown, broken = [], []
    for number, decode, data in items:
        if decode is None:
            unknown.append(number)
            continue
        try:
            decoded = decode(data)
        except BadKlv:
            broken.append(number)
            continue
        if decoded is not None:
            values[number] = decoded
    return LocalSet(values, tuple(unknown), tuple(broken))
