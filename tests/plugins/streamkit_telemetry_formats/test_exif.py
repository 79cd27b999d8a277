"""Exif data of photographs."""

import math
import struct
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_telemetry_formats.exif import ExifData, read_exif


def fractions(order: str, *pairs: tuple[int, int]) -> bytes:
    """Unsigned fractions as Exif writes them."""
    return b"".join(struct.pack(f"{order}II", *pair) for pair in pairs)


def directory(order: str, at: int, entries: list[tuple[int, int, int, bytes]]) -> bytes:
    """A directory that stands at an offset: tag, type, count and value of each entry; values follow it."""
    body, values = struct.pack(f"{order}H", len(entries)), b""
    end = at + 2 + 12 * len(entries) + 4
    for tag, kind, count, value in entries:
        if len(value) <= 4:
            body += struct.pack(f"{order}HHI", tag, kind, count) + value.ljust(4, b"\0")
        else:
            body += struct.pack(f"{order}HHII", tag, kind, count, end + len(values))
            values += value
    return body + bytes(4) + values


def tiff(order: str, latitude_side: bytes = b"S", altitude_side: int = 1) -> bytes:
    """Exif data of a photograph at 33 deg 30' 36" south, 7 deg 15' east, 12.5 m below the sea."""
    camera_at = 8 + 2 + 12 * 2 + 4
    focal = struct.pack(f"{order}H", 24)
    camera = directory(order, camera_at, [(0xA405, 3, 1, focal)])
    gps_at = camera_at + len(camera)
    entries = [
        (1, 2, 2, latitude_side + b"\0"),
        (2, 5, 3, fractions(order, (33, 1), (30, 1), (360, 10))),
        (3, 2, 2, b"E\0"),
        (4, 5, 3, fractions(order, (7, 1), (15, 1), (0, 1))),
        (5, 1, 1, bytes([altitude_side])),
        (6, 5, 1, fractions(order, (125, 10))),
        (7, 5, 3, fractions(order, (14, 1), (30, 1), (152, 10))),
        (16, 2, 2, b"T\0"),
        (17, 5, 1, fractions(order, (2705, 10))),
        (29, 2, 11, b"2024:05:06\0"),
    ]
    top = [
        (0x8769, 4, 1, struct.pack(f"{order}I", camera_at)),
        (0x8825, 4, 1, struct.pack(f"{order}I", gps_at)),
    ]
    head = (b"II" if order == "<" else b"MM") + struct.pack(f"{order}HI", 42, 8)
    return head + directory(order, 8, top) + camera + directory(order, gps_at, entries)


@pytest.mark.parametrize("order", ["<", ">"])
def test_either_byte_order_is_read(order: str) -> None:
    """Position, altitude, direction, time and focal length are those that were written."""
    found = read_exif(tiff(order))
    assert found.position == pytest.approx((-33.51, 7.25))
    assert found.altitude == -12.5
    assert found.direction == pytest.approx(math.radians(270.5))
    assert found.focal_35mm == 24
    assert found.utc_ns is not None
    moment = datetime(2024, 5, 6, 14, 30, 15, 200_000, tzinfo=UTC)
    assert found.utc_ns == round(moment.timestamp() * 1e6) * 1000


def test_letters_give_the_hemisphere() -> None:
    """North is positive, and so is above the sea."""
    found = read_exif(tiff("<", b"N", altitude_side=0))
    assert found.position == pytest.approx((33.51, 7.25))
    assert found.altitude == 12.5


@pytest.mark.parametrize(
    "data", [b"", b"II", b"XX*\0\x08\0\0\0", b"II*\0\xff\xff\xff\xff", b"II+\0\x08\0\0\0"]
)
def test_data_without_exif_has_no_values(data: bytes) -> None:
    """Empty, short, of another kind, or pointing out of itself: everything is None."""
    assert read_exif(data) == ExifData()


@given(st.integers(0, 400), st.binary(min_size=1, max_size=12))
def test_damage_never_raises(place: int, damage: bytes) -> None:
    """Any bytes overwritten leave values that are finite or None."""
    whole = tiff("<")
    found = read_exif(whole[:place] + damage + whole[place + len(damage) :])
    numbers = [found.altitude, found.direction, found.focal_35mm, *(found.position or ())]
    assert all(number is None or math.isfinite(number) for number in numbers)


@given(st.integers(0, 400))
def test_a_cut_never_raises(length: int) -> None:
    """A truncated file gives the values before its end."""
    assert read_exif(tiff(">")[:length]).position in (None, pytest.approx((-33.51, 7.25)))
