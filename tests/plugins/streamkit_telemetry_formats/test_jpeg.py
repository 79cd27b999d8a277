"""Photographs that are damaged, or none."""

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from streamkit_telemetry_formats.photograph import sample_of_photograph

PLAIN = cv2.imencode(".jpg", np.zeros((48, 64, 3), np.uint8))[1].tobytes()
XMP = b"http://ns.adobe.com/xap/1.0/\0<x drone-dji:GpsLatitude='10.5' drone-dji:GpsLongitude='-20.25'/>"


def segment(marker: int, content: bytes) -> bytes:
    """A segment with its length."""
    return bytes([0xFF, marker]) + (len(content) + 2).to_bytes(2, "big") + content


def test_exif_and_xmp_are_distinguished() -> None:
    """Both stand in segments of the same number and are known by how they begin."""
    own = segment(0xE1, b"Exif\0\0II*\0") + segment(0xE1, XMP)
    more = b"\xff"  # a fill byte before the next marker
    sample = sample_of_photograph(PLAIN[:2] + own + more + PLAIN[2:], 0)
    assert sample is not None
    assert (sample.latitude, sample.longitude) == (10.5, -20.25)


def test_other_data_has_no_position() -> None:
    """A plain JPEG, PNG and nothing have none."""
    png = cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes()
    assert (
        sample_of_photograph(PLAIN, 0) is sample_of_photograph(png, 0) is sample_of_photograph(b"", 0) is None
    )


@given(st.integers(0, len(PLAIN)), st.binary(max_size=20))
def test_damage_never_raises(place: int, damage: bytes) -> None:
    """A file cut anywhere and followed by random bytes has no position."""
    assert sample_of_photograph(PLAIN[:place] + damage, 0) is None
