"""JPEG over RTP."""

import pytest

from streamkit_media.rtsp.rtspinput import has_no_size

BEGIN, DEPTH, REST = b"\xff\xd8\xff\xe0\0\x02", b"\0\x11\x08", b"\x03\x01\x22\0"


@pytest.mark.parametrize(
    ("size", "expected"),
    [
        (b"\0\xf0\x01\x40", False),
        (b"\0\0\0\0", True),
        (b"\0\xf0\0\0", True),
        (b"\0\0\x01\x40", True),
        (b"\0", False),
    ],
)
def test_a_size_that_is_missing_is_found(size: bytes, expected: bool) -> None:
    """In the height or the width; a picture that is cut short is left to the decoder."""
    picture = BEGIN + b"\xff\xc0" + DEPTH + size
    assert has_no_size(picture if len(size) < 4 else picture + REST) is expected


def test_bytes_without_a_frame_header_say_nothing() -> None:
    """As of a damaged picture."""
    assert not has_no_size(BEGIN + REST)
