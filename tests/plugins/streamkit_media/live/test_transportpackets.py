import random
from collections import Counter
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit_media.live.transportpackets import TransportPackets, rtp_payload_start

AsRtp = Callable[..., bytes]


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
