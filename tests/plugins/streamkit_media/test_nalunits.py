import pytest

from streamkit_media.nalunits import length_field, units

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
