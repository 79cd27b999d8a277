"""Looks at the RTP packet that comes next on a TCP connection, and leaves it there for FFmpeg to read.

Source: RFC 2326, 10.12 (packets within the connection); RFC 3550, 5.1 (header of RTP).
"""

from __future__ import annotations

import select
import socket
import struct
import time
from contextlib import suppress

# Before each packet: "$", the channel, the size.
FRAME = struct.Struct(">cBH")
FRAME_BYTES, HEADER_BYTES, EXTENSION_HEAD_BYTES = FRAME.size, 12, 4
MAGIC, VERSION = ord("$"), 2
MARKER, EXTENSION, SOURCES = 0x80, 0x10, 0x0F
# Second byte of RTCP packets (RFC 5761, 4).
FIRST_REPORT, LAST_REPORT = 192, 223
LOOK_BYTES = 2048
PEEK = int(socket.MSG_PEEK | socket.MSG_DONTWAIT)
# How often, and how long each time, what stands behind a report is waited for.
BEHIND_REPORT_TRIES, BEHIND_REPORT_S = 3, 0.001


class HeadReader:
    """The packet that the next read of a connection begins with.

    Args:
        connection: a duplicate of FFmpeg's own socket; closed with this.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._poll = select.poll()
        self._poll.register(connection.fileno(), select.POLLIN)

    def close(self) -> None:
        """Gives the duplicate back."""
        self._connection.close()

    def look(self) -> bytes:
        """The beginning of the next RTP packet, reports passed over; empty where none is there yet."""
        return head_of(self._bytes())

    def wait(self, limit_s: float) -> bytes:
        """The same, once something has come; empty at the end, too."""
        # A server that gathers small segments (Nagle) holds the last one of a picture until the others are
        # acknowledged, which this side would put off for as long as a frame. It does not stay set.
        with suppress(OSError):
            self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        if not self._poll.poll(max(0.0, limit_s) * 1000):
            return b""
        for _ in range(BEHIND_REPORT_TRIES):
            data = self._bytes()
            if (head := head_of(data)) or not is_report(data):
                return head
            time.sleep(BEHIND_REPORT_S)
        return self.look()

    def _bytes(self) -> bytes:
        try:
            return self._connection.recv(LOOK_BYTES, PEEK)
        except OSError:  # nothing there, or the connection is over: FFmpeg will find out
            return b""


def is_report(data: bytes) -> bool:
    """Whether an RTCP packet comes first."""
    return (
        len(data) > FRAME_BYTES + 1
        and data[0] == MAGIC
        and FIRST_REPORT <= data[FRAME_BYTES + 1] <= LAST_REPORT
    )


def head_of(data: bytes) -> bytes:
    """The beginning of the first RTP packet on a connection, reports passed over; no two have the same.

    Args:
        data: what lies there, from the beginning of a packet on; the end may be missing.
    """
    while is_report(data):
        data = data[FRAME_BYTES + FRAME.unpack_from(data)[2] :]
    if len(data) < FRAME_BYTES + HEADER_BYTES or data[0] != MAGIC or data[FRAME_BYTES] >> 6 != VERSION:
        return b""
    end = FRAME_BYTES + _fixed_bytes(data[FRAME_BYTES])
    return data[:end] if len(data) >= end else b""


def is_marked(head: bytes) -> bool:
    """Whether a packet says that it is the last of a picture."""
    return bool(head and head[FRAME_BYTES + 1] & MARKER)


def payload_bytes(head: bytes) -> int:
    """What a packet carries, padding included."""
    size = _fixed_bytes(head[FRAME_BYTES])
    if head[FRAME_BYTES] & EXTENSION:
        size += 4 * int.from_bytes(head[-2:], "big")
    whole: int = FRAME.unpack_from(head)[2]
    return whole - size


def _fixed_bytes(first: int) -> int:
    """Bytes of an RTP header up to the size of its extension, as its first byte tells."""
    return HEADER_BYTES + 4 * (first & SOURCES) + (EXTENSION_HEAD_BYTES if first & EXTENSION else 0)
