import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import av
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit_media.live.transportstream import (
    CLOCK_TICKS,
    MAX_HELD_BYTES,
    NextStream,
    TransportPackets,
    frame_time,
    rtp_payload_start,
)
from streamkit_media.udp import PACKET_BYTES

AsRtp = Callable[..., bytes]
DATAGRAM = 7 * PACKET_BYTES
TABLE = b"\x47\x40\x00\x10" + bytes(184)


def packets_of(count: int) -> bytes:
    """Transport packets whose content holds no sync byte."""
    return b"".join(b"\x47" + bytes([number % 64]) * 187 for number in range(count))


def test_whole_packets_pass_as_they_are() -> None:
    """A datagram of whole transport packets is its own payload."""
    reception = Counter[str]()
    assert TransportPackets(reception).payload(packets_of(7)) == packets_of(7)
    assert not +reception


@given(st.integers(400, 2000), st.integers(0, 187))
def test_packets_cut_in_two_pass(size: int, skipped: int) -> None:
    """Senders that fill datagrams up cut packets in two; reception may begin anywhere."""
    data, reception = packets_of(60)[skipped:], Counter[str]()
    packets = TransportPackets(reception)
    pieces = [data[at : at + size] for at in range(0, len(data), size)]
    assert b"".join(map(packets.payload, pieces)) == data
    assert reception["refused"] == 0


def test_what_is_no_transport_stream_is_refused() -> None:
    """Datagrams without sync bytes are counted, and do not disturb those after them."""
    reception, generator = Counter[str](), random.Random(3)
    packets = TransportPackets(reception)
    for _ in range(200):
        assert packets.payload(packets_of(7)) == packets_of(7)
        assert packets.payload(b"\x00" + generator.randbytes(700)) == b""
    assert reception["refused"] == 200


def test_a_doubled_datagram_is_refused() -> None:
    """A network that doubles datagrams gives no frame twice; stuffing is the same again and again."""
    reception, packets = Counter[str](), packets_of(14)
    taker = TransportPackets(reception)
    sent = [packets[:1316], packets[:1316], packets[:1316], packets[1316:], packets[:1316]]
    assert [bool(taker.payload(datagram)) for datagram in sent] == [True, False, False, True, True]
    assert reception["refused"] == 2
    stuffing = (b"\x47\x1f\xff\x10" + b"\xff" * 184) * 7
    assert taker.payload(stuffing) == taker.payload(stuffing) == stuffing


@pytest.mark.parametrize("header", [b"\x80", b"\x90", b"\x83"])
def test_rtp_headers_are_removed(header: bytes) -> None:
    """The header has 12 bytes, more with contributing sources or an extension."""
    more = {b"\x80": b"", b"\x90": b"\xbe\xde\x00\x02" + bytes(8), b"\x83": bytes(12)}[header]
    datagram = header + b"\x21\x00\x01" + bytes(8) + more + packets_of(7)
    assert TransportPackets(Counter()).payload(datagram) == packets_of(7)


def test_gaps_repetitions_and_restarts(as_rtp: AsRtp) -> None:
    """Missing numbers are lost, old ones are refused, another source or a far number counts anew."""
    reception = Counter[str]()
    packets = TransportPackets(reception)

    def takes(number: int, source: int = 7) -> bool:
        return bool(packets.payload(as_rtp(packets_of(1), number, source)))

    assert [takes(number) for number in (65534, 65535, 0, 1)] == [True] * 4
    assert [takes(1), takes(0), takes(4)] == [False, False, True]
    assert (reception["lost"], reception["refused"]) == (2, 2)
    assert takes(30_000)
    assert takes(5, source=8)
    assert (reception["lost"], reception["refused"]) == (2, 2)


@settings(max_examples=300)
@given(st.lists(st.one_of(st.binary(max_size=400), st.binary(max_size=400).map(lambda b: b"\x90\x21" + b))))
def test_any_bytes_are_taken_or_refused(datagrams: list[bytes]) -> None:
    """Nothing fails, and nothing comes out that did not go in."""
    reception = Counter[str]()
    packets = TransportPackets(reception)
    for datagram in datagrams:
        assert packets.payload(datagram) in datagram
        assert 0 <= rtp_payload_start(datagram) <= len(datagram)
    assert reception["refused"] <= len(datagrams)


def frame_at(time: int, pid: int = 256) -> bytes:
    """The transport packet in which a frame of this decoding time begins."""
    clock = (
        bytes([0x11 | time >> 29 & 0xE])
        + (time >> 14 & 0xFFFE | 1).to_bytes(2)
        + (time << 1 & 0xFFFE | 1).to_bytes(2)
    )
    header = b"\0\0\1\xe0\0\0\x80\xc0\x0a" + bytes(5) + clock
    return b"\x47" + (0x4000 | pid).to_bytes(2) + b"\x10" + header.ljust(184, b"\xff")


def next_stream(pid: int | None = 256, timeout_s: float = 5.0) -> NextStream:
    """One that knows the video."""
    found = NextStream(timeout_s)
    found.video_pid = pid
    return found


@pytest.mark.parametrize("cut", [0, 5, 187])
def test_another_stream_is_found_from_its_first_table(clip: Path, cut: int) -> None:
    """Behind the rest of another, which may begin within a packet; all that has come of it is there."""
    stream = clip.read_bytes()
    with av.open(str(clip)) as container:
        pid = container.streams.video[0].id
    old, new = stream[20 * DATAGRAM + cut : 60 * DATAGRAM], stream[: 30 * DATAGRAM]
    search, found, come = next_stream(pid), b"", b""
    assert not search.begun(old)
    while not found:
        part = new[len(come) : len(come) + DATAGRAM]
        come, found = come + part, search.begun(part)
    assert come.endswith(found)
    assert 0 <= len(come) - len(found) < 4 * PACKET_BYTES  # the service description, before the table


@pytest.mark.parametrize(
    ("before", "after", "is_next"),
    [
        (90_000, 93_600, False),
        (90_000, 90_000 - 40_000, False),
        (90_000, 0, True),
        (90_000, 90_000 + 5 * 90_000, False),
        (90_000, 90_000 + 6 * 90_000, True),
        (CLOCK_TICKS - 1800, 1800, False),
        (3600 * 90_000, 3600, True),
    ],
)
def test_a_leap_of_the_times_is_another_stream(before: int, after: int, is_next: bool) -> None:
    """Back by more than half a second, or on by more than silence may last; not where the clock wraps."""
    search = next_stream()
    assert search.begun(frame_at(before)) == b""
    assert search.begun(TABLE) == b""
    assert search.begun(frame_at(after)) == (TABLE + frame_at(after) if is_next else b"")


def test_only_the_video_that_is_read_counts() -> None:
    """Neither another video's times end the stream, nor those that leap before the video is known."""
    search = next_stream(None)
    assert search.begun(frame_at(900_000) + frame_at(0)) == b""
    search.video_pid = 256
    assert search.begun(frame_at(900_000, 257) + frame_at(0, 257) + frame_at(3600)) == b""
    assert search.begun(frame_at(900_000))


def test_a_table_of_the_stream_before_is_not_taken() -> None:
    """A frame behind it belongs to the same stream; without a table the next stream begins with its frame."""
    search = next_stream()
    assert search.begun(TABLE + frame_at(900_000)) == b""
    assert search.begun(frame_at(0)) == frame_at(0)


def test_what_is_kept_is_bounded() -> None:
    """A stream without frames does not fill the memory."""
    search = next_stream()
    search.begun(TABLE)
    for _ in range(3):
        search.begun((b"\x47\x01\x01\x10" + bytes(184)) * (MAX_HELD_BYTES // PACKET_BYTES))
        assert len(search._held) <= MAX_HELD_BYTES


@pytest.mark.parametrize("packet", [b"\x47\x40\x11\x10" + bytes(184), b"\x47\x40\x11\x30\xff" + bytes(183)])
def test_a_packet_without_a_frames_start_has_no_time(packet: bytes) -> None:
    """Also where the field before the payload claims more bytes than there are."""
    assert frame_time(packet) is None


@settings(max_examples=300)
@given(st.lists(st.binary(max_size=400).map(lambda data: b"\x47\x41\x00" + data)))
def test_any_bytes_are_searched(parts: list[bytes]) -> None:
    """Nothing fails, and what is found is the end of what has come."""
    search = next_stream()
    come = b""
    for part in parts:
        come += part
        assert come.endswith(search.begun(part))
