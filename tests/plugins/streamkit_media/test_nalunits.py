import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_media.nalunits import BadPacket, is_reference, length_field, parameter_sets, units

AVCC = bytes.fromhex("0142c00affe1")


def test_length_fields() -> None:
    """The box says how long lengths are; extradata that are no box mean start codes."""
    assert length_field("h264", AVCC) == 4
    assert length_field("h264", AVCC[:4] + b"\xfd") == 2
    assert length_field("h264", bytes.fromhex("0000000167")) == 0
    assert length_field("hevc", b"") == 0


@pytest.mark.parametrize(
    ("data", "length_bytes", "found"),
    [
        ("", 0, []),
        ("09", 0, []),
        ("000001 0910 000001 6588", 0, ["0910", "6588"]),
        ("00000001 0910 00000001 65", 0, ["091000", "65"]),
        ("00000002 0910 00000003 658811", 4, ["0910", "658811"]),
        ("0002 0910 00ff 65", 2, ["0910", "65"]),
        ("0002 0910 00", 2, ["0910"]),
    ],
)
def test_units(data: str, length_bytes: int, found: list[str]) -> None:
    """Units come without what divides them; what is cut short comes as far as it is there."""
    assert [unit.hex() for unit in units(bytes.fromhex(data.replace(" ", "")), length_bytes)] == found


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
    """Only what the standard calls non-reference may be left out; what is unknown stays."""
    assert is_reference(codec, bytes.fromhex(data.replace(" ", "")), extradata) is referenced


AVCC_BOX = bytes.fromhex("0142c00affe1 0003 67aabb 01 0002 68cc".replace(" ", ""))
HVCC_BOX = bytes(21) + bytes.fromhex("03 02 20 0001 0003 400101 21 0002 0001 42 0002 4201".replace(" ", ""))


def test_parameter_sets() -> None:
    """Both boxes and start codes give the sets in their order."""
    assert [unit.hex() for unit in parameter_sets("h264", AVCC_BOX)] == ["67aabb", "68cc"]
    assert [unit.hex() for unit in parameter_sets("hevc", HVCC_BOX)] == ["400101", "42", "4201"]
    assert [unit.hex() for unit in parameter_sets("hevc", bytes.fromhex("0000000140010000014201"))] == [
        "4001",
        "4201",
    ]


@given(st.sampled_from([("h264", AVCC_BOX), ("hevc", HVCC_BOX)]), st.integers(0, 44), st.binary(max_size=40))
def test_damaged_boxes_are_refused(codec_box: tuple[str, bytes], cut: int, tail: bytes) -> None:
    """A box that is cut or overwritten gives sets from within it or an error, never a crash."""
    codec, box = codec_box
    data = box[:cut] + tail
    try:
        found = list(parameter_sets(codec, data))
    except BadPacket:
        return
    assert sum(map(len, found)) <= len(data)
