"""The latest transport packets of a stream, from which a sender that begins anew is read again.

FFmpeg has read past the point where the new stream begins when its times tell so: without what it has read,
the first keyframe would be lost, and all frames up to the next one.

Source: ISO/IEC 13818-1, 2.4.3.2 (transport packet), 2.4.3.6 (PES packet), 2.4.4.3 (program association).
"""

from __future__ import annotations

from collections import deque

from streamkit_media.live.transportpackets import SYNC
from streamkit_media.udp import PACKET_BYTES

MAX_BYTES = 16 << 20  # more than two frames; older ones go
TABLE_PID = 0  # of the program association table, with which a stream begins
CLOCK_TICKS = 1 << 33  # at which times begin again
PES_START = b"\0\0\1"


class RecentPackets:
    """The transport packets given to FFmpeg since the last frame but one."""

    def __init__(self) -> None:
        self._parts: deque[bytes] = deque()
        self._size = 0
        self._new = self._last = 0  # parts since the last frame, and of those between it and the one before

    def add(self, part: bytes) -> None:
        """Takes the next transport packets."""
        self._parts.append(part)
        self._size += len(part)
        self._new += 1
        while self._size > MAX_BYTES:
            self._size -= len(self._parts.popleft())

    def end_frame(self) -> None:
        """Forgets the packets before the last frame but one; called when FFmpeg has given out a frame."""
        while len(self._parts) > self._new + self._last:
            self._size -= len(self._parts.popleft())
        self._new, self._last = 0, self._new

    def since(self, pid: int, decoding_time: int) -> bytes:
        """The packets from the beginning of a new stream, found by its first frame.

        Args:
            pid: of the stream's video.
            decoding_time: of its first frame, ticks of 90 kHz.

        Returns:
            The packets from the last program association table before that frame; empty if not found.
        """
        data, table = b"".join(self._parts), None
        for start in range(_first_packet(data), len(data) - PACKET_BYTES + 1, PACKET_BYTES):
            packet = data[start : start + PACKET_BYTES]
            found = int.from_bytes(packet[1:3]) & 0x1FFF
            if packet[0] != SYNC:  # a packet is missing in part
                return b""
            if found == TABLE_PID:
                table = start
            if found == pid and pes_time(packet) == decoding_time % CLOCK_TICKS:
                return b"" if table is None else data[table:]
        return b""


def _first_packet(data: bytes) -> int:
    """Offset of the first whole transport packet; the length of the data if there is none."""
    for start in range(min(PACKET_BYTES, len(data))):
        marks = data[start : start + 8 * PACKET_BYTES : PACKET_BYTES]
        if marks.count(SYNC) == len(marks):
            return start
    return len(data)


def pes_time(packet: bytes) -> int | None:
    """The decoding time of the PES packet that begins in a transport packet, ticks; None if none does."""
    has_start, has_adaptation = packet[1] & 0x40, packet[3] & 0x20
    payload = packet[4 + (1 + packet[4] if has_adaptation else 0) :]
    if not has_start or not payload.startswith(PES_START) or len(payload) < 19 or not payload[7] & 0x80:
        return None
    high, *rest = payload[14:19] if payload[7] & 0x40 else payload[9:14]  # the other is the time of display
    middle, low = int.from_bytes(rest[:2]) >> 1, int.from_bytes(rest[2:]) >> 1
    return (high >> 1 & 7) << 30 | middle << 15 | low
