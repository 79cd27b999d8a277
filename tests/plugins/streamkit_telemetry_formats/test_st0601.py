import math
from collections.abc import Callable
from pathlib import Path

import pytest

from streamkit_telemetry_formats.klv import BadKlv, KlvReader, elements
from streamkit_telemetry_formats.st0601 import (
    MAX_TEXT,
    TAGS,
    decode_local_set,
    imapb,
    nested,
    signed,
    text,
)

klvdata = pytest.importorskip("klvdata", reason="klvdata, the independent decoder, is not installed")

# Tags that klvdata decodes to a number, the factor from its unit to ours, and the range of the values.
DEGREES = {5: 360, 6: 40, 7: 100, 16: 180, 17: 180, 18: 360, 19: 360, 20: 360}
PLAIN = {13: 180, 14: 360, 15: 19900, 21: 5e6, 22: 1e4, 23: 180, 24: 360, 25: 19900}
PLAIN |= dict.fromkeys(range(26, 34), 0.15)
TEXTS = (3, 10, 11, 12)


def test_values_equal_an_independent_decoders(streamkit_data: Path) -> None:
    """All values of 407 real packets agree with klvdata's to 1e-6 of their range."""
    data = (streamkit_data / "telemetry" / "Cheyenne.bin").read_bytes()
    compared: dict[int, int] = {}
    for ours, theirs in zip(KlvReader().feed(data), klvdata.StreamParser(data), strict=True):
        values = decode_local_set(ours.value).values
        others = {
            int.from_bytes(key, "big"): item.value.value
            for key, item in theirs.items.items()
            if hasattr(getattr(item, "value", None), "value")
        }
        for tag, value in values.items():
            if tag in DEGREES or tag in PLAIN:
                assert isinstance(value, float)
                own = math.degrees(value) if tag in DEGREES else value
                span = DEGREES.get(tag) or PLAIN[tag]
                assert abs(own - float(others[tag])) < 1e-6 * span, TAGS[tag].name
            elif tag in TEXTS:
                assert value == others[tag]
            elif tag == 2:
                assert value == round(others[tag].timestamp() * 1e6) * 1000
            else:
                continue
            compared[tag] = compared.get(tag, 0) + 1
    assert len(compared) >= 20
    assert compared[13] == 407


def test_the_standards_own_example(streamkit_data: Path) -> None:
    """The packet of the standard's appendix has the values printed there."""
    data = (streamkit_data / "telemetry" / "DynamicOnlyMISMMSPacketData.bin").read_bytes()
    (packet,) = KlvReader().feed(data)
    values = decode_local_set(packet.value).values
    printed = {13: 60.1768229669783, 14: 128.426759042045, 15: 14190.7195, 23: -10.5423886331461, 65: 6}
    for tag, value in printed.items():
        assert values[tag] == pytest.approx(value, rel=1e-8)
    in_degrees = {5: 159.974365, 6: -0.431531724, 7: 3.40586566, 18: 160.719211474396, 19: -168.792324833941}
    for tag, value in in_degrees.items():
        assert math.degrees(float(values[tag])) == pytest.approx(value, rel=1e-6)


def test_every_tag_of_the_standard_is_listed() -> None:
    """1 to 143 without a gap, each name once."""
    assert sorted(TAGS) == list(range(1, 144))
    assert len({tag.name for tag in TAGS.values()}) == 143


def test_out_of_range_has_no_value() -> None:
    """The lowest number of a signed mapping means "no value" and is left out."""
    assert signed(90, 4)(b"\x80\x00\x00\x00") is None
    assert signed(90, 4)(b"\x7f\xff\xff\xff") == 90
    assert signed(90, 4)(b"\x80\x00\x00\x01") == -90
    assert 13 not in decode_local_set(b"\x0d\x04\x80\x00\x00\x00").values


@pytest.mark.parametrize(
    ("low", "high", "data", "value"),
    [
        (-900, 40_000, "2f921e", 23456.24),  # ST 0601, tags 103 to 105
        (-900, 9_000, "0ea7", 10.0),  # ST 1201 shape: value near a multiple of the step
        (0, 1_500_000, "00d92a", 13898.5463),  # ST 0601, tag 96
        (0, 100, "a0", None),
    ],
)
def test_imapb(low: float, high: float, data: str, value: float | None) -> None:
    """Mapped numbers of any length come back; the special patterns are no values."""
    got = imapb(low, high)(bytes.fromhex(data))
    if value is None:
        assert got is None
    elif value == 10.0:
        assert isinstance(got, float)
        assert low <= got <= high
    else:
        assert got == pytest.approx(value, abs=0.5)


def test_broken_and_unknown_tags_are_set_apart() -> None:
    """A value of the wrong length costs only itself; tags of later editions are named."""
    decoded = decode_local_set(bytes.fromhex("0d0212340f02c221820001ff"))
    assert list(decoded.values) == [15]
    assert decoded.broken == (13,)
    assert decoded.unknown == (256,)


def test_texts_are_bounded_and_never_fail() -> None:
    """Bytes that are no UTF-8 become marks; a text of many kilobytes is refused."""
    assert decode_local_set(b"\x03\x02\xff\x41").values == {3: "\ufffdA"}
    assert TAGS[3].decode(b"UAV\0\0") == "UAV"
    with pytest.raises(BadKlv, match="at most 4096 bytes"):
        TAGS[3].decode(bytes(5000))
    assert dict(elements(b"\x03\x01A")) == {3: b"A"}


def test_every_tag_has_its_length_rule() -> None:
    """Numbers take eight bytes at most and texts 4096; longer values are refused for every tag."""
    decoders = {tag: entry.decode for tag, entry in TAGS.items() if entry.decode is not nested}
    assert 100 < len(decoders) < len(TAGS)
    assert nested(b"any length") == b"any length"
    for tag, decode in decoders.items():
        limit = MAX_TEXT if decode is text else 8
        assert_refused(tag, decode, b"\x01" * (limit + 1), "bytes")
        if decode is not text:
            assert_refused(tag, decode, b"", "a value must have")


def assert_refused(tag: int, decode: Callable[[bytes], object], value: bytes, words: str) -> None:
    """A tag refuses a value with these words."""
    with pytest.raises(BadKlv, match=words):
        pytest.fail(f"tag {tag} takes {len(value)} bytes: {decode(value)!r}")


def test_lengths_the_standard_gives() -> None:
    """One byte for an airspeed, two for a weapon load, one to four for a time in the air."""
    good = {8: 1, 34: 1, 56: 1, 60: 2, 62: 2, 65: 1, 77: 1, 110: 3, 123: 1, 131: 5, 136: 2}
    for tag, size in good.items():
        assert isinstance(TAGS[tag].decode(b"\x01" * size), int), TAGS[tag].name
        most = {110: 4, 131: 8, 136: 4}.get(tag, size)
        with pytest.raises(BadKlv, match="a value must have"):
            TAGS[tag].decode(b"\x01" * (most + 1))


def test_times_are_64_bit_nanoseconds() -> None:
    """A time that a signed 64-bit number of nanoseconds cannot hold is refused."""
    latest = (2**63 - 1) // 1000
    assert TAGS[2].decode(latest.to_bytes(8, "big")) == latest * 1000
    with pytest.raises(BadKlv, match="before the year 2263"):
        TAGS[2].decode((latest + 1).to_bytes(8, "big"))


def test_imapb_stays_within_its_range() -> None:
    """Numbers that the mapping has room for but the range has not are no value."""
    assert imapb(0, 100)(b"\x64") == 100
    assert imapb(0, 100)(b"\x65") is None


def test_real_packets_break_no_rule(streamkit_data: Path) -> None:
    """Not one value of 407 packets of an encoder in use is refused."""
    data = (streamkit_data / "telemetry" / "Cheyenne.bin").read_bytes()
    assert {decode_local_set(packet.value).broken for packet in KlvReader().feed(data)} == {()}
