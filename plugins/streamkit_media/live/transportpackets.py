"""MPEG transport streams in datagrams: the packets, bare or in RTP.

Source: ISO/IEC 13818-1, section 2.4.3; for RTP, RFC 3550, section 5.1, and RFC 2250, section 2.
"""

from __future__ import annotations

from collections import Counter

from streamkit_media.udp import PACKET_BYTES

SYNC = 0x47
RTP_HEADER_BYTES = 12
RTP_VERSION = 2
MPEG_TS = 33  # RTP's payload type
NUMBERS = 1 << 16
MAX_GAP, MAX_LATE = 3000, 100  # beyond them the sender has restarted its numbers (RFC 3550, appendix A.1)


class TransportPackets:
    """Takes the datagrams of one connection.

    Args:
        counts: datagrams `lost`, missing in RTP's sequence numbers, and `refused`: no transport stream,
            repeated or late.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self._counts = counts
        self._phase = 0  # bytes of the next datagram before a packet begins: some senders cut packets in two
        self._source = b""
        self._next_number = 0

    def payload(self, datagram: bytes) -> bytes:
        """The transport packets in a datagram; empty where it has none that are new."""
        start = rtp_payload_start(datagram)
        if start:
            found = datagram[start:] if self._accepts_number(datagram) else b""
        else:
            found = datagram if self._finds_packets(datagram) else b""
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


def rtp_payload_start(datagram: bytes) -> int:
    """Offset of the transport packets in an RTP packet; 0 if it carries none."""
    if len(datagram) <= RTP_HEADER_BYTES or datagram[0] >> 6 != RTP_VERSION or datagram[1] & 0x7F != MPEG_TS:
        return 0
    start = RTP_HEADER_BYTES + 4 * (datagram[0] & 0x0F)
    if datagram[0] & 0x10:  # an extension: profile, length in words
        start += 4 + 4 * int.from_bytes(datagram[start + 2 : start + 4])
    is_whole = start < len(datagram) and (len(datagram) - start) % PACKET_BYTES == 0
    return start if is_whole and datagram[start] == SYNC else 0
