"""The headers of JPEG files."""

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from streamkit_telemetry_formats.photograph import JpegHeader, read_header

PLAIN = cv2.imencode(".jpg", np.zeros((48, 64, 3), np.uint8))[1].tobytes()


def segment(marker: int, content: bytes) -> bytes:
    """A segment with its length."""
    return bytes([0xFF, marker]) + (len(content) + 2).to_bytes(2, "big") + content


def test_size_is_that_of_the_frame() -> None:
    """Width and height come from the frame's header; a plain file has neither Exif nor XMP."""
    assert read_header(PLAIN) == JpegHeader(b"", b"", (64, 48))


def test_exif_and_xmp_are_distinguished() -> None:
    """Both stand in segments of the same number and are known by how they begin; the first of each counts."""
    own = segment(0xE1, b"Exif\0\0II*\0") + segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0<x/>")
    more = segment(0xE1, b"Exif\0\0MM") + b"\xff"  # a fill byte before the next marker
    assert read_header(PLAIN[:2] + own + more + PLAIN[2:]) == JpegHeader(b"II*\0", b"<x/>", (64, 48))


def test_other_data_has_no_jpeg_header() -> None:
    """PNG and nothing give an empty header."""
    png = cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes()
    assert read_header(png) == read_header(b"") == JpegHeader()


@given(st.integers(0, len(PLAIN)), st.binary(max_size=20))
def test_damage_never_raises(place: int, damage: bytes) -> None:
    """A file cut anywhere and followed by random bytes gives a header."""
    assert read_header(PLAIN[:place] + damage).exif == b""
