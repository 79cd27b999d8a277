"""MPEG transport streams in the datagrams of a udp:// URL: the socket, and the packets, bare or in RTP.

Source: ISO/IEC 13818-1, section 2.4.3; for RTP, RFC 3550, section 5.1, and RFC 2250, section 2.
"""

from __future__ import annotations

import errno
import ipaddress
import socket
import struct
from collections import Counter
from functools import partial
from urllib.parse import parse_qsl, urlsplit

from streamkit_media.datagram_socket import PACKET_BYTES, SocketAddress, datagram_socket

BUFFER_BYTES = 8 << 20
EVERYWHERE = "0.0.0.0"
COUNT_OVERFLOWS = getattr(socket, "SO_RXQ_OVFL", 40)  # Linux's number; Python has no name for it
OVERFLOWS = struct.Struct("=I")
REMEDIES = {
    errno.EADDRINUSE: "another program receives there; end it, or have the video sent to another port",
    errno.EADDRNOTAVAIL: "no interface of this machine has the address; write udp://@:PORT for all of them",
    errno.ENODEV: "no interface leads to the group; name one by its address, as in ?localaddr=192.168.1.2",
}
SYNC = 0x47
RTP_HEADER_BYTES = 12
RTP_VERSION = 2
MPEG_TS = 33  # RTP's payload type
NUMBERS = 1 << 16
MAX_GAP, MAX_LATE = 3000, 100  # beyond them the sender has restarted its numbers (RFC 3550, appendix A.1)


def datagram_address(location: str) -> tuple[str, int, str]:
    """The address in udp://[@]HOST:PORT[?localaddr=ADDRESS]; HOST may be empty.

    Returns:
        The address of an interface, of a multicast group, or `EVERYWHERE`; the port; and the address of the
        interface on which a group is joined, "" for the system's choice.

    Raises:
        ValueError: it is no such URL.
    """
    parts = urlsplit(location)
    fields = dict(parse_qsl(parts.query, keep_blank_values=True))
    local_address = fields.pop("localaddr", "")
    if not parts.port:
        raise ValueError("the port is missing")
    if fields:
        raise ValueError(f"it takes ?localaddr=ADDRESS only, not {', '.join(sorted(fields))}")
    return parts.hostname or local_address or EVERYWHERE, parts.port, local_address


def open_receiver(host: str, port: int, local_address: str = "") -> socket.socket:
    """A socket bound to an address, in the group if it is one, with a large buffer.

    Raises:
        OSError: with the remedy in its text.
    """
    prepare = partial(_prepare, local=local_address)
    return datagram_socket(host, port, prepare, REMEDIES, "name another address or port")


def _prepare(receiver: socket.socket, target: SocketAddress, local: str) -> None:
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    receiver.setsockopt(socket.SOL_SOCKET, COUNT_OVERFLOWS, 1)
    group = ipaddress.ip_address(target[0].partition("%")[0])
    if not group.is_multicast:
        # Without SO_REUSEADDR: a second receiver of the port would take the datagrams from the first.
        receiver.bind(target)
        return
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    receiver.bind(target)  # to the group, as the port alone would bring other groups too
    if group.version == 4:
        interface = socket.inet_aton(local or EVERYWHERE)
        receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group.packed + interface)
    else:
        scope = target[3] if len(target) == 4 else 0
        receiver.setsockopt(
            socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, group.packed + struct.pack("=I", scope)
        )


def overflows(ancillary: list[tuple[int, int, bytes]]) -> int:
    """Datagrams that the kernel has dropped since the socket was opened; 0 where it does not say."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, COUNT_OVERFLOWS) and len(data) == OVERFLOWS.size:
            return int(OVERFLOWS.unpack(data)[0])
    return 0


class TransportPackets:
    """Takes the datagrams of one connection.

    Args:
        counts: datagrams `lost`, missing in RTP's sequence numbers, and `refused`: no transport stream,
            repeated or late.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self._counts = counts
        self._phase = 0  # bytes before the next sync byte: some senders cut packets in two
        self._source = b""
        self._next_number = 0

    def payload(self, datagram: bytes) -> bytes:
        """The transport packets in a datagram; empty where it has none that are new."""
        start = rtp_payload_start(datagram)
        if start:
            found = datagram[start:] if self._is_next(datagram) else b""
        else:
            found = datagram if self._is_transport_stream(datagram) else b""
        self._counts["refused"] += not found
        return found

    def _is_next(self, datagram: bytes) -> bool:
        """Whether an RTP packet is neither late nor repeated; counts those missing before it."""
        number, source = int.from_bytes(datagram[2:4]), datagram[8:12]
        gap = (number - self._next_number) % NUMBERS if source == self._source else 0
        if gap >= NUMBERS - MAX_LATE:
            return False
        self._counts["lost"] += gap if gap < MAX_GAP else 0
        self._source, self._next_number = source, (number + 1) % NUMBERS
        return True

    def _is_transport_stream(self, datagram: bytes) -> bool:
        """Whether sync bytes are where the datagram before, a beginning, or any phase would have them."""
        for phase in (self._phase, *range(PACKET_BYTES)):
            marks = datagram[phase::PACKET_BYTES]
            is_expected = phase == self._phase or (phase == 0 and len(marks) > 0)
            # Elsewhere one byte alone would be chance.
            if marks.count(SYNC) == len(marks) and (is_expected or len(marks) > 1):
                self._phase = (phase - len(datagram)) % PACKET_BYTES
                return True
        return False


def rtp_payload_start(datagram: bytes) -> int:
    """Where the transport packets in an RTP packet begin; 0 if it is none that carries them."""
    if len(datagram) <= RTP_HEADER_BYTES or datagram[0] >> 6 != RTP_VERSION or datagram[1] & 0x7F != MPEG_TS:
        return 0
    start = RTP_HEADER_BYTES + 4 * (datagram[0] & 0x0F)
    if datagram[0] & 0x10:  # an extension: profile, length in words
        start += 4 + 4 * int.from_bytes(datagram[start + 2 : start + 4])
    is_whole = start < len(datagram) and (len(datagram) - start) % PACKET_BYTES == 0
    return start if is_whole and datagram[start] == SYNC else 0
