"""Peeks at the header of the next RTP packet on a TCP connection and leaves the packet for FFmpeg to read.

Source: RFC 2326, 10.12 (RTP interleaved in the connection); RFC 3550, 5.1 (RTP header).
"""

from __future__ import annotations

import select
import socket
import struct
import time
from contextlib import suppress

# Before each packet: "$", the channel, the size.
FRAME = struct.Struct(">cBH")
FRAME_BYTES, HEADER_BYTES, EXTENSION_HEADER_BYTES = FRAME.size, 12, 4
MAGIC, VERSION = ord("$"), 2
MARKER, EXTENSION, SOURCES = 0x80, 0x10, 0x0F
# Second byte of RTCP packets (RFC 5761, 4).
FIRST_RTCP, LAST_RTCP = 192, 223
PEEK_BYTES = 2048
PEEK = int(socket.MSG_PEEK | socket.MSG_DONTWAIT)
AFTER_RTCP_TRIES, AFTER_RTCP_S = 3, 0.001  # waits for what follows an RTCP packet


class RtpHeaders:
    """The header of the packet that the next read of a connection begins with.

    Args:
        connection: a duplicate of FFmpeg's own socket; closed with this.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._poll = select.poll()
        self._poll.register(connection.fileno(), select.POLLIN)

    def close(self) -> None:
        """Closes the duplicate."""
        self._connection.close()

    def peek(self) -> bytes:
        """The header of the next RTP packet, after any RTCP packets; empty where none has come yet."""
        return first_header(self._bytes())

    def wait(self, limit_s: float) -> bytes:
        """As `peek`, once something has come; empty also at the end."""
        # A server with Nagle's algorithm sends the last small segment of a frame only when the others are
        # acknowledged, which this side would delay. The option does not stay set.
        with suppress(OSError):
            self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        if not self._poll.poll(max(0.0, limit_s) * 1000):
            return b""
        for _ in range(AFTER_RTCP_TRIES):
            data = self._bytes()
            if (header := first_header(data)) or not is_rtcp(data):
                return header
            time.sleep(AFTER_RTCP_S)
        return self.peek()

    def _bytes(self) -> bytes:
        try:
            return self._connection.recv(PEEK_BYTES, PEEK)
        except OSError:  # nothing there, or the connection is closed: FFmpeg reports that
            return b""


def is_rtcp(data: bytes) -> bool:
    """Whether an RTCP packet comes first."""
    return (
        len(data) > FRAME_BYTES + 1 and data[0] == MAGIC and FIRST_RTCP <= data[FRAME_BYTES + 1] <= LAST_RTCP
    )


def first_header(data: bytes) -> bytes:
    """The header of the first RTP packet, after any RTCP packets; b"" where it is incomplete."""
    while is_rtcp(data):
        data = data[FRAME_BYTES + FRAME.unpack_from(data)[2] :]
    if len(data) < FRAME_BYTES + HEADER_BYTES or data[0] != MAGIC or data[FRAME_BYTES] >> 6 != VERSION:
        return b""
    end = FRAME_BYTES + _fixed_bytes(data[FRAME_BYTES])
    return data[:end] if len(data) >= end else b""


def is_marked(header: bytes) -> bool:
    """Whether a packet is marked as the last of its frame."""
    return bool(header and header[FRAME_BYTES + 1] & MARKER)


def payload_bytes(header: bytes) -> int:
    """The size of a packet's payload, padding included."""
    size = _fixed_bytes(header[FRAME_BYTES])
    if header[FRAME_BYTES] & EXTENSION:
        size += 4 * int.from_bytes(header[-2:], "big")
    whole: int = FRAME.unpack_from(header)[2]
    return whole - size


def _fixed_bytes(first: int) -> int:
    """Bytes of an RTP header up to the size of its extension, from its first byte."""
    return HEADER_BYTES + 4 * (first & SOURCES) + (EXTENSION_HEADER_BYTES if first & EXTENSION else 0)
