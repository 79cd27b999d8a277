"""RTP headers, read before FFmpeg reads the packets."""

import socket
import struct
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_media.rtsp.rtspinput import first_header, peek, wait_for_header


def packet(number: int = 1, *, marked: bool = False, body: bytes = b"body", extension: int = -1) -> bytes:
    """An RTP packet as it stands in the connection; an extension of so many words, or none."""
    first = 0x80 | (0x10 if extension >= 0 else 0)
    head = struct.pack(">BBHII", first, 96 | (0x80 if marked else 0), number, 90_000, 7)
    if extension >= 0:
        head += struct.pack(">HH", 0xBEDE, extension) + bytes(4 * extension)
    return struct.pack(">cBH", b"$", 0, len(head) + len(body)) + head + body


def report() -> bytes:
    """A sender report."""
    return struct.pack(">cBH", b"$", 1, 28) + struct.pack(">BBHIQIII", 0x80, 200, 6, 7, 1, 2, 3, 4)


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    """The server's end of a connection, and what looks at the other."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        client = socket.create_connection(listener.getsockname())
        server, _ = listener.accept()
        server.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with server, client:
            yield server, client


@pytest.mark.parametrize("marked", [False, True])
@pytest.mark.parametrize("extension", [-1, 0, 3])
def test_a_packet_has_marker_and_payload(*, marked: bool, extension: int) -> None:
    """The mark, and how many bytes are carried without header and extension."""
    header = first_header(packet(marked=marked, body=bytes(100), extension=extension))
    assert header is not None
    assert (header.is_marked, header.payload_bytes) == (marked, 100)


def test_rtcp_reports_are_skipped() -> None:
    """The header of a packet behind reports is found; a report alone has none."""
    assert first_header(report() + report() + packet(5, marked=True)) == first_header(packet(5, marked=True))
    assert first_header(report()) is None


@pytest.mark.parametrize("data", [b"", b"$", b"RTSP/1.0 200 OK\r\n\r\n", packet()[:15]])
def test_other_data_has_no_header(data: bytes) -> None:
    """RTSP answers and incomplete headers give none."""
    assert first_header(data) is None


@given(st.binary(max_size=200))
def test_any_bytes_are_accepted(data: bytes) -> None:
    """No bytes of a server raise an error."""
    header = first_header(b"$" + data)
    assert header is None or header.data in b"$" + data


def test_peeking_consumes_nothing(ends: tuple[socket.socket, socket.socket]) -> None:
    """A peeked header stays the same until it is read."""
    server, reader = ends
    assert peek(reader) is None
    server.sendall(packet(3))
    first = wait_for_header(reader, 5)
    assert first == first_header(packet(3))
    server.sendall(packet(4))
    assert peek(reader) == first


def test_waiting_is_bounded_and_ends_with_the_connection(ends: tuple[socket.socket, socket.socket]) -> None:
    """A wait ends at its limit, or at once when the server closes."""
    server, reader = ends
    assert wait_for_header(reader, 0.01) is None
    server.close()
    assert wait_for_header(reader, 60) is None


def test_a_packet_behind_a_report_is_waited_for(ends: tuple[socket.socket, socket.socket]) -> None:
    """A wait returns the header of the packet behind a report."""
    server, reader = ends
    server.sendall(report() + packet(9, marked=True))
    assert wait_for_header(reader, 5) == first_header(packet(9, marked=True))
