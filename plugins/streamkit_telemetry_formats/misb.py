"""Samples of telemetry from the sets of MISB: UAS local sets, and the older universal sets ("Predator").

Tags may have different rates. A universal set is decoded to the tags of its successor, the local set; it has
no checksum, and is valid if its elements fit into it. Its sensor angles are left out, because they refer to
the horizon and not to the platform.

Source: MISB EG 0104.5, section 4; MISB ST 0601.12, section 8 (keys and types of the universal set).
"""

from __future__ import annotations

import struct

from streamkit_telemetry_formats.klv import BadKlv, KlvPacket, KlvReader, universal_elements
from streamkit_telemetry_formats.sample import Position, Sample
from streamkit_telemetry_formats.st0601 import (
    RAD,
    Decoder,
    LocalSet,
    Value,
    decode_local_set,
    decode_tags,
    text,
    time,
)

HOLD_NS = 5_000_000_000  # validity of a tag that is not sent again
ABOVE_ELLIPSOID, ABOVE_SEA = "misb", "misb above sea level"


class MisbTelemetry:
    """Converts the bytes of a KLV stream to samples."""

    def __init__(self) -> None:
        self.reader = KlvReader()  # counts good and bad packets
        self.broken_tags = 0  # values left out because their length or range violates the standard
        self.poses = 0  # samples made
        self._held: dict[int, tuple[int, int | float | str | bytes]] = {}
        self._clock_zero: int | None = None

    def feed(self, data: bytes, pts: int | None) -> list[Sample]:
        """The samples of the packets that these bytes complete.

        Args:
            data: any piece of the stream.
            pts: on the video's timeline, ns. None if the stream has no timestamps: times then count from the
                first packet by the platform's clock, and packets without that clock are skipped.
        """
        return self._samples(self.reader.feed(data), pts)

    def finish(self, pts: int | None) -> list[Sample]:
        """The samples of the packets held back, at the end of the stream."""
        return self._samples(self.reader.finish(), pts)

    def _samples(self, packets: list[KlvPacket], pts: int | None) -> list[Sample]:
        found = []
        for packet in packets:
            decode = decode_universal_set if packet.is_universal_set else decode_local_set
            try:
                local_set = decode(packet.value)
            except BadKlv:
                self.reader.bad += 1
                self.reader.good -= 1
                continue
            self.broken_tags += len(local_set.broken)
            shown = self._clock_time(local_set.values.get(2)) if pts is None else pts
            sample = None if shown is None else self._sample(local_set, shown)
            if sample is not None:
                found.append(sample)
        self.poses += len(found)
        return found

    def _clock_time(self, time_ns: object) -> int | None:
        """Time since the first packet by the platform's clock, ns."""
        if not isinstance(time_ns, int):
            return None
        if self._clock_zero is None:
            self._clock_zero = time_ns
        return time_ns - self._clock_zero

    def _sample(self, local_set: LocalSet, pts: int) -> Sample | None:
        self._held.update({tag: (pts, value) for tag, value in local_set.values.items()})
        self._held = {tag: item for tag, item in self._held.items() if 0 <= pts - item[0] <= HOLD_NS}
        return sample_of({tag: value for tag, (_, value) in self._held.items()}, pts)


def sample_of(values: dict[int, int | float | str | bytes], pts: int) -> Sample | None:
    """The sample of decoded tags; None without a position."""
    numbers = {tag: float(value) for tag, value in values.items() if isinstance(value, int | float)}
    if 13 not in numbers or 14 not in numbers:
        return None
    ellipsoid = numbers.get(104, numbers.get(75))
    time_ns = values.get(2)
    return Sample(
        numbers[13],
        numbers[14],
        pts=pts,
        altitude=numbers.get(15) if ellipsoid is None else ellipsoid,
        heading=numbers.get(5),
        pitch=numbers.get(90, numbers.get(6)),
        roll=numbers.get(91, numbers.get(7)),
        sensor_angles=(numbers[18], numbers[19], numbers[20]) if {18, 19, 20} <= numbers.keys() else None,
        field_of_view=(numbers[16], numbers[17]) if {16, 17} <= numbers.keys() else None,
        frame_centre=_position(numbers, 23, 24, 78 if 78 in numbers else 25),
        ground_altitude=numbers.get(25 if ellipsoid is None else 78),
        corners=_corners(numbers),
        target=_position(numbers, 40, 41, 42),
        utc_ns=time_ns if isinstance(time_ns, int) else None,
        source=ABOVE_SEA if ellipsoid is None and 15 in numbers else ABOVE_ELLIPSOID,
    )


def _position(numbers: dict[int, float], latitude: int, longitude: int, elevation: int) -> Position | None:
    if latitude not in numbers or longitude not in numbers:
        return None
    return numbers[latitude], numbers[longitude], numbers.get(elevation)


def _corners(numbers: dict[int, float]) -> tuple[tuple[float, float], ...]:
    """The corners by the full corner tags, else by the offsets from the frame's centre."""
    if set(range(82, 90)) <= numbers.keys():
        return tuple((numbers[tag], numbers[tag + 1]) for tag in range(82, 90, 2))
    if {23, 24, *range(26, 34)} <= numbers.keys():
        return tuple((numbers[23] + numbers[tag], numbers[24] + numbers[tag + 1]) for tag in range(26, 34, 2))
    return ()


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
