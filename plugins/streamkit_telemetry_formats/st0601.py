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
MAX_TEXT = 4096
LATEST_TIME_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class St0601Tag:
    """One element of the local set."""

    name: str  # as in the standard
    unit: str  # of the decoded value, or ""
    decode: Decoder  # bytes to value; None is the standard's "out of range" or "error"


@dataclass(frozen=True, slots=True)
class LinearMap:
    """Integers of `size` bytes for numbers from `low` to `high`, in the standard's unit, and back.

    A signed integer maps 0 to 0, and its lowest number means "no value".
    """

    low: float
    high: float
    size: int
    scale: float = 1.0  # of the standard's unit, in that of the value
    is_signed: bool = False

    def __call__(self, data: bytes) -> Value:
        """The value of some bytes; raises `BadKlv` where they have another size."""
        _check_size(data, self.size)
        number = int.from_bytes(data, "big", signed=self.is_signed)
        if number < -self._largest:
            return None
        return (number * (self.high - self._zero) / self._largest + self._zero) * self.scale

    def encode(self, value: float) -> bytes | None:
        """The bytes of a value; None out of the range."""
        number = value / self.scale
        if not self.low <= number <= self.high:
            return None
        share = (number - self._zero) / (self.high - self._zero)
        return round(share * self._largest).to_bytes(self.size, "big", signed=self.is_signed)

    @property
    def _zero(self) -> float:
        """What the integer 0 stands for."""
        return 0.0 if self.is_signed else self.low

    @property
    def _largest(self) -> int:
        return (1 << 8 * self.size - self.is_signed) - 1


def unsigned(low: float, high: float, size: int, scale: float = 1.0) -> LinearMap:
    """An unsigned integer mapped linearly onto low..high."""
    return LinearMap(low, high, size, scale)


def signed(bound: float, size: int, scale: float = 1.0) -> LinearMap:
    """A signed integer mapped linearly onto -bound..bound."""
    return LinearMap(-bound, bound, size, scale, is_signed=True)


def integer(size: int = 0, *, scale: int = 1, most: int = 8, is_signed: bool = False) -> Decoder:
    """An integer as it is; `size` bytes, 0 for one to `most`."""

    def decode(data: bytes) -> Value:
        _check_size(data, size, most)
        return int.from_bytes(data, "big", signed=is_signed) * scale

    return decode


def time(size: int = 0) -> Decoder:
    """Microseconds since 1970 as ns; times after the year 2262 do not fit into 64 bits and are refused."""
    microseconds = integer(size)

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
    if len(data) > MAX_TEXT:
        raise BadKlv(f"a text has at most {MAX_TEXT} bytes, got {len(data)}")
    return data.decode("utf-8", "replace").rstrip("\0")


def nested(data: bytes) -> Value:
    """A nested set or pack, left as bytes."""
    return data


def _check_size(data: bytes, size: int, most: int = 8) -> None:
    if not data or len(data) > (size or most) or (size and len(data) != size):
        raise BadKlv(f"a value must have {size or f'1 to {most}'} bytes, got {len(data)}")


RAD = math.pi / 180
HPA = 100.0

# Unit and decoder of tags: the name of each, as in the standard.
_GROUPS: tuple[tuple[str, Decoder, dict[int, str]], ...] = (
    ("", nested, {
        48: "Security Local Set", 66: "Target Location Covariance Matrix", 73: "RVT Local Set",
        74: "VMTI Local Set", 81: "Image Horizon Pixel Pack", 94: "MIIS Core Identifier",
        95: "SAR Motion Imagery Local Set", 97: "Range Image Local Set", 98: "Geo-Registration Local Set",
        99: "Composite Imaging Local Set", 100: "Segment Local Set", 101: "Amend Local Set", 102: "SDCC-FLP",
        115: "Control Command", 116: "Control Command Verification List", 121: "Active Wavelength List",
        122: "Country Codes", 127: "Sensor Frame Rate Pack", 128: "Wavelengths List",
        130: "Airbase Locations", 138: "Payload List", 139: "Active Payloads", 140: "Weapons Stores",
        141: "Waypoint List", 142: "View Domain", 143: "Metadata Substream ID Pack",
    }),
    ("", text, {
        3: "Mission ID", 4: "Platform Tail Number", 10: "Platform Designation", 11: "Image Source Sensor",
        12: "Image Coordinate System", 59: "Platform Call Sign", 70: "Alternate Platform Name",
        106: "Stream Designator", 107: "Operational Base", 108: "Broadcast Source", 129: "Target ID",
        135: "Communications Method",
    }),
    ("", integer(1), {
        34: "Icing Detected", 47: "Generic Flag Data", 61: "Weapon Fired", 63: "Sensor Field of View Name",
        65: "UAS Datalink LS Version Number", 77: "Operational Mode", 123: "Number of NAVSATs in View",
        124: "Positioning Method Source", 125: "Platform Status", 126: "Sensor Control Mode",
    }),
    ("", integer(2), {1: "Checksum", 60: "Weapon Load", 62: "Laser PRF Code"}),
    ("ns", time(size=8), {2: "Precision Time Stamp", 72: "Event Start Time"}),
    ("ns", time(), {131: "Take-off Time"}),
    ("ns", integer(scale=1000, is_signed=True), {137: "Correction Offset"}),
    ("s", integer(most=4), {110: "Time Airborne"}),
    ("s", integer(most=4, is_signed=True), {136: "Leap Seconds"}),
    ("deg", signed(90, 4), {
        13: "Sensor Latitude", 23: "Frame Center Latitude", 40: "Target Location Latitude",
        67: "Alternate Platform Latitude",
        **{80 + 2 * point: f"Corner Latitude Point {point} (Full)" for point in range(1, 5)},
    }),
    ("deg", signed(180, 4), {
        14: "Sensor Longitude", 24: "Frame Center Longitude", 41: "Target Location Longitude",
        68: "Alternate Platform Longitude",
        **{81 + 2 * point: f"Corner Longitude Point {point} (Full)" for point in range(1, 5)},
    }),
    ("deg", signed(0.075, 2), {
        24 + 2 * point + at: f"Offset Corner {axis} Point {point}"
        for point in range(1, 5) for at, axis in enumerate(("Latitude", "Longitude"))
    }),
    ("rad", unsigned(0, 360, 2, RAD), {
        5: "Platform Heading Angle", 35: "Wind Direction", 64: "Platform Magnetic Heading",
        71: "Alternate Platform Heading",
    }),
    ("rad", signed(20, 2, RAD), {
        6: "Platform Pitch Angle", 50: "Platform Angle of Attack", 52: "Platform Sideslip Angle",
    }),
    ("rad", signed(50, 2, RAD), {7: "Platform Roll Angle"}),
    ("rad", unsigned(0, 180, 2, RAD), {
        16: "Sensor Horizontal Field of View", 17: "Sensor Vertical Field of View",
    }),
    ("rad", unsigned(0, 360, 4, RAD), {
        18: "Sensor Relative Azimuth Angle", 20: "Sensor Relative Roll Angle",
    }),
    ("rad", signed(180, 4, RAD), {
        19: "Sensor Relative Elevation Angle", 93: "Platform Sideslip Angle (Full)",
    }),
    ("rad", signed(90, 4, RAD), {
        90: "Platform Pitch Angle (Full)", 91: "Platform Roll Angle (Full)",
        92: "Platform Angle of Attack (Full)",
    }),
    ("rad", imapb(0, 360, RAD), {112: "Platform Course Angle"}),
    ("rad/s", imapb(-1000, 1000, RAD, most=4), {
        117: "Sensor Azimuth Rate", 118: "Sensor Elevation Rate", 119: "Sensor Roll Rate",
    }),
    ("m", unsigned(-900, 19_000, 2), {
        15: "Sensor True Altitude", 25: "Frame Center Elevation", 38: "Density Altitude",
        42: "Target Location Elevation", 54: "Airfield Elevation", 69: "Alternate Platform Altitude",
        75: "Sensor Ellipsoid Height", 76: "Alternate Platform Ellipsoid Height",
        78: "Frame Center Height Above Ellipsoid",
    }),
    ("m", imapb(-900, 40_000), {
        103: "Density Altitude Extended", 104: "Sensor Ellipsoid Height Extended",
        105: "Alternate Platform Ellipsoid Height Extended", 113: "Altitude Above Ground Level",
        114: "Radar Altimeter",
    }),
    ("m", unsigned(0, 5_000_000, 4), {21: "Slant Range", 57: "Ground Range"}),
    ("m", unsigned(0, 10_000, 2), {22: "Target Width"}),
    ("m", imapb(0, 1_500_000), {96: "Target Width Extended"}),
    ("m", unsigned(0, 4095, 2), {45: "Target Error Estimate CE90", 46: "Target Error Estimate LE90"}),
    ("m", imapb(0, 21_000, 1000, most=4), {109: "Range To Recovery Location"}),
    ("m/s", integer(1), {
        8: "Platform True Airspeed", 9: "Platform Indicated Airspeed", 56: "Platform Ground Speed",
    }),
    ("m/s", unsigned(0, 100, 1), {36: "Wind Speed"}),
    ("m/s", signed(180, 2), {51: "Platform Vertical Speed"}),
    ("m/s", signed(327, 2), {79: "Sensor North Velocity", 80: "Sensor East Velocity"}),
    ("Pa", unsigned(0, 5000, 2, HPA), {
        37: "Static Pressure", 49: "Differential Pressure", 53: "Airfield Barometric Pressure",
    }),
    ("deg C", integer(1, is_signed=True), {39: "Outside Air Temperature"}),
    ("px", integer(1, scale=2), {43: "Target Track Gate Width", 44: "Target Track Gate Height"}),
    ("%", unsigned(0, 100, 1), {55: "Relative Humidity"}),
    ("%", imapb(0, 100, most=4), {120: "On-board MI Storage Percent Full", 134: "Zoom Percentage"}),
    ("kg", unsigned(0, 10_000, 2), {58: "Platform Fuel Remaining"}),
    ("1/min", integer(most=4), {111: "Propulsion Unit Speed"}),
    ("Hz", imapb(1, 99_999, 1e6, most=4), {132: "Transmission Frequency"}),
    ("GB", integer(most=4), {133: "On-board MI Storage Capacity"}),
)  # fmt: skip
TAGS = {tag: St0601Tag(name, unit, decode) for unit, decode, names in _GROUPS for tag, name in names.items()}


@dataclass(frozen=True, slots=True)
class LocalSet:
    """A decoded UAS local set."""

    # by tag, in the units of `TAGS`; "no value" and unknown tags are left out
    values: dict[int, int | float | str | bytes]
    unknown: tuple[int, ...] = ()  # tags that are not in `TAGS`
    broken: tuple[int, ...] = ()  # tags whose bytes violate the standard; their values are left out


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
