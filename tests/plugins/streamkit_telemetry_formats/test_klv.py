import random
import time
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_telemetry_formats.klv import (
    KEY_PREFIX,
    UAS_LOCAL_SET,
    UNIVERSAL_SET,
    BadKlv,
    KlvReader,
    checksum,
    elements,
    read_length,
    read_tag,
)


def packet(value: bytes = b"\x02\x08" + bytes(8), long_length: bool = False) -> bytes:
    """A whole packet with its checksum."""
    value += b"\x01\x02"
    size = len(value) + 2
    length = b"\x82" + size.to_bytes(2, "big") if long_length or size > 127 else bytes([size])
    data = UAS_LOCAL_SET + length + value
    return data + checksum(data).to_bytes(2, "big")


def boundaries(data: bytes) -> list[int]:
    """Where the packets of a recording begin, and its end."""
    found, at = [], data.find(UAS_LOCAL_SET)
    while at >= 0:
        found.append(at)
        at = data.find(UAS_LOCAL_SET, at + 1)
    return [*found, len(data)]


def test_a_recording_is_whole(streamkit_data: Path) -> None:
    """All 407 packets of a real recording have a good checksum, and no byte is outside of them."""
    reader = KlvReader()
    data = (streamkit_data / "telemetry" / "Cheyenne.bin").read_bytes()
    assert len(reader.feed(data) + reader.finish()) == 407
    assert (reader.good, reader.bad, reader.skipped) == (407, 0, 0)


@pytest.mark.parametrize("piece", [1, 7, 188, 1000])
def test_split_packets_are_joined(streamkit_data: Path, piece: int) -> None:
    """However the bytes are cut, the same packets come out."""
    data = (streamkit_data / "telemetry" / "Cheyenne.bin").read_bytes()[:6000]
    whole, cut = KlvReader(), KlvReader()
    found = [p for at in range(0, len(data), piece) for p in cut.feed(data[at : at + piece])]
    assert found == whole.feed(data)
    assert len(found) > 20


def test_one_flipped_byte_rejects_each_packet(streamkit_data: Path) -> None:
    """A byte changed anywhere in every packet: every one is refused, and the search ends."""
    data = bytearray((streamkit_data / "telemetry" / "Cheyenne.bin").read_bytes())
    chance = random.Random(1)
    for begin, end in pairwise(boundaries(bytes(data))):
        data[chance.randrange(begin, end)] ^= chance.randrange(1, 256)
    reader = KlvReader()
    assert reader.feed(bytes(data)) + reader.finish() == []
    assert reader.skipped == len(data)


def test_damage_costs_only_the_damaged_packet(streamkit_data: Path) -> None:
    """After a flipped byte in every third packet the two between are found again."""
    data = bytearray((streamkit_data / "telemetry" / "Cheyenne.bin").read_bytes())
    chance = random.Random(2)
    places = list(pairwise(boundaries(bytes(data))))
    for begin, end in places[::3]:
        data[chance.randrange(begin, end)] ^= chance.randrange(1, 256)
    reader = KlvReader()
    found = [p for at in range(0, len(data), 500) for p in reader.feed(bytes(data[at : at + 500]))]
    assert len(found) + len(reader.finish()) == len(places) - len(places[::3])


def test_a_damaged_length_does_not_hold_up_the_stream() -> None:
    """A packet that claims 60000 bytes is given up when the next one begins."""
    broken = bytearray(packet(long_length=True))
    broken[17:19] = (60000).to_bytes(2, "big")
    reader = KlvReader()
    assert reader.feed(bytes(broken)) == []
    assert len(reader.feed(packet())) == 1
    assert reader.bad == 1


@given(st.binary(max_size=300), st.integers(1, 40))
def test_any_bytes_are_accepted(noise: bytes, piece: int) -> None:
    """Noise, also noise that begins like a packet, neither raises nor hides the packet behind it."""
    reader = KlvReader()
    data = noise + UAS_LOCAL_SET + noise + packet()
    found = [p for at in range(0, len(data), piece) for p in reader.feed(data[at : at + piece])]
    found += reader.finish()
    assert packet() in [p.data for p in found]
    assert reader.skipped + sum(len(p.data) for p in found) == len(data)


def test_lengths() -> None:
    """Short and long BER lengths; missing bytes give None; other forms are refused."""
    assert read_length(b"\x05", 0) == (5, 1)
    assert read_length(b"\x82\x01\x00", 0) == (256, 3)
    assert read_length(b"\x82\x01", 0) is None
    assert read_length(b"", 0) is None
    for data in (b"\x80", b"\x89" + bytes(9)):
        with pytest.raises(BadKlv, match="BER length"):
            read_length(data, 0)


def test_tags() -> None:
    """Tags beyond 127 take two bytes; one without end is refused."""
    assert read_tag(b"\x41", 0) == (65, 1)
    assert read_tag(b"\x81\x0f", 0) == (143, 2)
    assert read_tag(b"\x81", 0) is None
    with pytest.raises(BadKlv, match="at most four bytes"):
        read_tag(b"\x81\x81\x81\x81\x01", 0)


def test_an_element_beyond_its_set_is_refused() -> None:
    """A length that leads out of the set is an error, not a short value."""
    with pytest.raises(BadKlv, match="at byte 3 reaches beyond"):
        list(elements(b"\x41\x01\x07\x05\x09\x00"))


def block_that_ends_others(keys: int = 2800) -> bytes:
    """A packet with a wrong checksum whose length leads to the end of another such packet."""
    size = keys * 23 - 19
    return UAS_LOCAL_SET + b"\x82" + size.to_bytes(2, "big") + b"\x01\x02\x00\x00"


@pytest.mark.parametrize(
    "block",
    [UAS_LOCAL_SET, KEY_PREFIX, block_that_ends_others(), UNIVERSAL_SET + b"\x83\x00\xff\xf0"],
    ids=["keys", "prefixes", "checksums", "universal"],
)
def test_searching_after_damage_takes_linear_time(block: bytes) -> None:
    """Four times as many broken packets take less than ten times as long (quadratic: sixteen times)."""

    def seconds(size: int) -> float:
        reader, data = KlvReader(), block * (size // len(block))
        began = time.process_time()
        assert reader.feed(data) + reader.finish() == []
        assert reader.skipped == len(data)
        return time.process_time() - began

    short = min(seconds(1 << 17) for _ in range(3))
    long = min(seconds(1 << 19) for _ in range(3))
    assert long < 10 * max(short, 0.005)


def test_the_checksum_counts_bytes_at_even_offsets_256_times() -> None:
    """The 16-bit sum of the standard, of an odd number of bytes too."""
    assert checksum(b"\x01\x02\x03") == 0x0402
    assert checksum(b"\xff" * 4) == (0xFF00 + 0xFF) * 2 & 0xFFFF


def test_packets_of_other_sets_are_skipped() -> None:
    """Packets of other sets in the stream are neither good nor bad."""
    other = bytes.fromhex("060e2b34020b01010e01030306000000") + b"\x05\x04\x01\x04\x65\x00"
    reader = KlvReader()
    assert [p.data for p in reader.feed(other + packet() + other) + reader.finish()] == [packet()]
    assert (reader.good, reader.bad, reader.skipped) == (1, 0, 2 * len(other))
