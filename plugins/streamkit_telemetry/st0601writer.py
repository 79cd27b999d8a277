"""MISB ST 0601 for writing: KLV elements, packets with their checksum, and the elements of a sample.

Source: SMPTE ST 336 (BER length, BER-OID); MISB ST 0107 (numbers); MISB ST 0601, checksum and tags 2, 5 to 7,
13 to 20, 23, 24, 65, 75, 82 to 91.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from streamkit.geometry.angles import wrap_turn
from streamkit_telemetry_formats.klv import CHECKSUM_HEAD, UAS_LOCAL_SET, checksum
from streamkit_telemetry_formats.sample import Sample

VERSION = 17  # of ST 0601
CIRCLE = 360.0
Encoder = Callable[[float], bytes | None]


def encode_time(utc_us: int) -> bytes:
    """The precision time stamp, which every packet begins with."""
    return element(2, utc_us.to_bytes(8, "big"))


def encode_version() -> bytes:
    """The version of the standard, which every packet has."""
    return element(65, bytes([VERSION]))


def encode_pose(sample: Sample) -> bytes:
    """The elements of a pose, without values out of their tag's range."""
    return b"".join(
        element(tag, data)
        for tag, value, encode in _items(sample)
        if value is not None and (data := encode(value)) is not None
    )


def _items(sample: Sample) -> Iterator[tuple[int, float | None, Encoder]]:
    azimuth, elevation, roll = sample.sensor_angles or (None, None, None)
    horizontal, vertical = sample.field_of_view or (None, None)
    yield 5, sample.heading, _circle(2)
    # The short forms reach 20 and 50 deg; tags 90 and 91 have the full range.
    yield 6, sample.pitch, _angle(20, 2)
    yield 7, sample.roll, _angle(50, 2)
    yield 13, sample.latitude, _degrees(90)
    yield 14, sample.longitude, _degrees(180)
    yield 15, sample.altitude if sample.source.endswith("above sea level") else None, _height
    yield 16, horizontal, _field
    yield 17, vertical, _field
    yield 18, azimuth, _circle(4)
    yield 19, elevation, _angle(180, 4)
    yield 20, roll, _circle(4)
    if sample.frame_centre is not None:
        yield 23, sample.frame_centre[0], _degrees(90)
        yield 24, sample.frame_centre[1], _degrees(180)
    yield 75, sample.altitude if sample.source == "misb" else None, _height
    for tag, (latitude, longitude) in zip(range(82, 90, 2), sample.corners, strict=False):
        yield tag, latitude, _degrees(90)
        yield tag + 1, longitude, _degrees(180)
    yield 90, sample.pitch, _angle(90, 4)
    yield 91, sample.roll, _angle(90, 4)


def _degrees(bound: float) -> Encoder:
    return lambda value: signed_map(value, bound, 4)


def _angle(bound: float, size: int) -> Encoder:
    return lambda value: signed_map(math.degrees(wrap_turn(value)), bound, size)


def _circle(size: int) -> Encoder:
    return lambda value: unsigned_map(math.degrees(value) % CIRCLE, 0, CIRCLE, size)


def _field(value: float) -> bytes | None:
    return unsigned_map(math.degrees(value), 0, 180, 2)


def _height(value: float) -> bytes | None:
    return unsigned_map(value, -900, 19_000, 2)


def ber_length(size: int) -> bytes:
    """A length in the shortest form."""
    if size < 0x80:
        return bytes([size])
    data = shortest(size)
    return bytes([0x80 | len(data)]) + data


def ber_oid(number: int) -> bytes:
    """A tag or identifier: seven bits a byte, all but the last with the highest bit set."""
    data = [number & 0x7F]
    while number := number >> 7:
        data.insert(0, 0x80 | number & 0x7F)
    return bytes(data)


def element(tag: int, value: bytes) -> bytes:
    """One element of a local set."""
    return ber_oid(tag) + ber_length(len(value)) + value


def local_set_packet(elements: bytes) -> bytes:
    """A UAS local set of these elements followed by their checksum; the time stamp must be the first."""
    data = UAS_LOCAL_SET + ber_length(len(elements) + 4) + elements + CHECKSUM_HEAD
    return data + checksum(data).to_bytes(2, "big")


def shortest(number: int) -> bytes:
    """An unsigned integer in as few bytes as it needs, one at least."""
    return number.to_bytes(max(1, (number.bit_length() + 7) // 8), "big")


def unsigned_map(value: float, low: float, high: float, size: int) -> bytes | None:
    """A number mapped linearly from low..high onto an unsigned integer; None out of the range."""
    if not low <= value <= high:
        return None
    return round((value - low) / (high - low) * ((1 << 8 * size) - 1)).to_bytes(size, "big")


def signed_map(value: float, bound: float, size: int) -> bytes | None:
    """A number mapped linearly from -bound..bound onto a signed integer; None out of the range."""
    if not -bound <= value <= bound:
        return None
    return round(value / bound * ((1 << 8 * size - 1) - 1)).to_bytes(size, "big", signed=True)
