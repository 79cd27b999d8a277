"""MPEG transport streams in datagrams: the packets, bare or in RTP, and where another stream begins.

Source: ISO/IEC 13818-1, sections 2.4.3.2 (transport packet), 2.4.3.6 (PES packet) and 2.4.4.3 (program
association); for RTP, RFC 3550, section 5.1, and RFC 2250, section 2.
"""

from __future__ import annotations

import re
from collections import Counter

from streamkit_media.udp import PACKET_BYTES

SYNC = 0x47
RTP_HEADER_BYTES = 12
RTP_VERSION = 2
MPEG_TS = 33  # RTP's payload type
NULL_HEADER = b"\x47\x1f\xff"  # of stuffing, which repeats by itself
NUMBERS = 1 << 16
MAX_GAP, MAX_LATE = 3000, 100  # beyond them the sender has restarted its numbers (RFC 3550, appendix A.1)
TABLE_PID = 0  # of the program association table, with which a stream begins
MAX_HELD_BYTES = 1 << 20  # from a table to the next frame
CLOCK_HZ, CLOCK_TICKS = 90_000, 1 << 33  # of decoding times, which begin again at 2^33
# Decoding times that fall by more, or rise by more and longer than silence may last, are of another stream.
RESTART_S = 0.5
UNIT_START = 0x40  # in the second byte of a packet in which a table or a PES packet begins
VIDEO_START = re.compile(b"\0\0\1[\xe0-\xef]")


class TransportPackets:
    """Takes the datagrams of one connection.

    Args:
        counts: datagrams `lost`, missing in RTP's sequence numbers, and `refused`: no transport stream,
            repeated or late.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self._counts = counts
        self._phase = 0  # bytes of the next datagram before a packet begins: some senders cut packets in two
        self._source = self._last = b""
        self._next_number = 0

    def payload(self, datagram: bytes) -> bytes:
        """The transport packets in a datagram; empty where it has none that are new."""
        start = rtp_payload_start(datagram)
        if start:
            found = datagram[start:] if self._accepts_number(datagram) else b""
        else:
            # Without numbers, one that the network has doubled is known by its bytes alone.
            is_new = datagram != self._last or datagram.startswith(NULL_HEADER)
            self._last = datagram
            found = datagram if is_new and self._finds_packets(datagram) else b""
        self._counts["refused"] += not found
        return found

    def _accepts_number(self, datagram: bytes) -> bool:
        """Takes the number of an RTP packet, and counts those missing; False if it is late or repeated."""
        number, source = int.from_bytes(datagram[2:4]), datagram[8:12]
        gap = (number - self._next_number) % NUMBERS if source == self._source else 0
        if gap >= NUMBERS - MAX_LATE:
            return False
        self._counts["lost"] += gap if gap < MAX_GAP else 0
        self._source, self._next_number = source, (number + 1) % NUMBERS
        return True

    def _finds_packets(self, datagram: bytes) -> bool:
        """Whether packets begin where the last datagram left off, else at the start, else anywhere.

        Each begins with a sync byte; where none is expected, one such byte alone would be chance.
        """
        for phase in (self._phase, *range(PACKET_BYTES)):
            marks = datagram[phase::PACKET_BYTES]
            needed = 0 if phase == self._phase else 1 if phase == 0 else 2
            if len(marks) >= needed and marks.count(SYNC) == len(marks):
                self._phase = (phase - len(datagram)) % PACKET_BYTES
                return True
        return False


class NextStream:
    """Finds where a sender begins another stream, as after a restart: the video's decoding times leap there.

    Args:
        timeout_s: longest silence within a stream, s.

    Attributes:
        video_pid: the packet identifier of the video; while None, no leap counts.
    """

    def __init__(self, timeout_s: float) -> None:
        self.video_pid: int | None = None
        self._most_ticks = round((timeout_s + RESTART_S) * CLOCK_HZ)
        self._times: dict[int, int] = {}  # the highest of each video, by its packet identifier, ticks
        self._held = bytearray()  # from the last table on if no frame follows it, else part of a packet
        self._has_table = False
        self._looked = 0  # bytes of what is held

    def begun(self, part: bytes) -> bytes:
        """Takes what has come next; all of the next stream that has come, from its table on, or nothing."""
        held = self._held
        held += part
        while len(held) >= self._looked + PACKET_BYTES:
            start = self._looked
            if held[start] != SYNC:  # a packet is missing in part
                self._looked += 1
                continue
            self._looked += PACKET_BYTES
            if not held[start + 1] & UNIT_START:
                continue
            packet = bytes(held[start : self._looked])
            pid = int.from_bytes(packet[1:3]) & 0x1FFF
            if pid == TABLE_PID:
                del held[:start]
                self._has_table, self._looked = True, PACKET_BYTES
            elif (time := frame_time(packet)) is not None:
                if self._leaps(pid, time):
                    return bytes(held if self._has_table else held[start:])
                self._has_table = False
        if not self._has_table or len(held) > MAX_HELD_BYTES:
            del held[: self._looked]
            self._has_table, self._looked = False, 0
        return b""

    def _leaps(self, pid: int, time: int) -> bool:
        step = (time - self._times.get(pid, time) + CLOCK_TICKS // 2) % CLOCK_TICKS - CLOCK_TICKS // 2
        leaps = not -RESTART_S * CLOCK_HZ <= step <= self._most_ticks
        if step > 0 or leaps or pid not in self._times:
            self._times[pid] = time
        return leaps and pid == self.video_pid


def frame_time(packet: bytes) -> int | None:
    """The decoding time of the frame of video that begins in a transport packet, ticks; None if none does."""
    payload = packet[4 + (1 + packet[4] if packet[3] & 0x20 else 0) :]  # behind the adaptation field
    if not VIDEO_START.match(payload) or len(payload) < 19 or not payload[7] & 0x80:
        return None
    high, *rest = payload[14:19] if payload[7] & 0x40 else payload[9:14]  # the other is the time of display
    middle, low = int.from_bytes(rest[:2]) >> 1, int.from_bytes(rest[2:]) >> 1
    return (high >> 1 & 7) << 30 | middle << 15 | low


def rtp_payload_start(datagram: bytes) -> int:
    """Offset of the transport packets in an RTP packet; 0 if it carries none."""
    if len(datagram) <= RTP_HEADER_BYTES or datagram[0] >> 6 != RTP_VERSION or datagram[1] & 0x7F != MPEG_TS:
        return 0
    start = RTP_HEADER_BYTES + 4 * (datagram[0] & 0x0F)
    if datagram[0] & 0x10:  # an extension: profile, length in words
        start += 4 + 4 * int.from_bytes(datagram[start + 2 : start + 4])
    is_whole = start < len(datagram) and (len(datagram) - start) % PACKET_BYTES == 0
    return start if is_whole and datagram[start] == SYNC else 0
