"""MISB ST 0601 for writing: KLV elements, packets with their checksum, and the elements of a pose.

Source: SMPTE ST 336 (BER length, BER-OID); MISB ST 0107 (numbers); MISB ST 0601, checksum and tags 2, 5 to 7,
13 to 20, 23, 24, 65, 75, 82 to 91.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain

from streamkit import Pose
from streamkit.geometry.angles import wrap_bearing, wrap_turn
from streamkit_telemetry_formats.klv import CHECKSUM_HEAD, UAS_LOCAL_SET, checksum
from streamkit_telemetry_formats.st0601 import TAGS, LinearMap

VERSION = 17  # of ST 0601
MAPS = {tag: item.decode for tag, item in TAGS.items() if isinstance(item.decode, LinearMap)}
WRAPS: dict[int, Callable[[float], float]] = {
    **dict.fromkeys((5, 18, 20), wrap_bearing),
    **dict.fromkeys((6, 7, 19, 90, 91), wrap_turn),
}


def encode_time(utc_us: int) -> bytes:
    """The precision time stamp, which every packet begins with."""
    return element(2, utc_us.to_bytes(8, "big"))


def encode_version() -> bytes:
    """The version of the standard, which every packet has."""
    return element(65, bytes([VERSION]))


def encode_pose(pose: Pose) -> bytes:
    """The elements of a pose, without values out of their tag's range."""
    return b"".join(
        element(tag, data)
        for tag, value in _values(pose).items()
        if value is not None and (data := MAPS[tag].encode(WRAPS.get(tag, float)(value))) is not None
    )


def _values(pose: Pose) -> dict[int, float | None]:
    """The values of a pose by their tags, in the order of the packet; None where unknown."""
    azimuth, elevation, roll = pose.sensor_angles or (None, None, None)
    horizontal, vertical = pose.field_of_view or (None, None)
    latitude, longitude, _ = pose.frame_centre or (None, None, None)
    return {
        5: pose.heading, 6: pose.pitch, 7: pose.roll,
        13: pose.latitude, 14: pose.longitude,
        15: pose.altitude if pose.source.endswith("above sea level") else None,
        16: horizontal, 17: vertical, 18: azimuth, 19: elevation, 20: roll, 23: latitude, 24: longitude,
        75: pose.altitude if pose.source == "misb" else None,
        **dict(zip(range(82, 90), chain.from_iterable(pose.corners), strict=False)),
        90: pose.pitch, 91: pose.roll,  # 6 and 7 reach 20 and 50 deg only
    }  # fmt: skip


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
