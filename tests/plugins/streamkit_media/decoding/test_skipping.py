import pytest

from streamkit_media.decoding.skipping import is_reference

AVCC = bytes.fromhex("0142c00affe1")


@pytest.mark.parametrize(
    ("codec", "data", "extradata", "referenced"),
    [
        ("h264", "00000001 65", b"", True),
        ("h264", "00000001 41", b"", True),
        ("h264", "00000001 0910 00000001 01", b"", False),
        ("h264", "000001 01 000001 41", b"", True),
        ("h264", "00000002 0910 00000002 0188", AVCC, False),
        ("h264", "00000002 4188", AVCC, True),
        ("hevc", "00000001 0201", b"", True),
        ("hevc", "00000001 0001", b"", False),
        ("hevc", "00000001 2601", b"", True),
        ("h264", "", b"", True),
        ("h264", "00000001 06", b"", True),
        ("vp9", "00", b"", True),
    ],
)
def test_references(codec: str, data: str, extradata: bytes, referenced: bool) -> None:
    """Only pictures that the standard calls non-reference may go; what cannot be told stays."""
    assert is_reference(codec, bytes.fromhex(data.replace(" ", "")), extradata) is referenced
