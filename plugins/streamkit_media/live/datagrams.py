"""The socket that receives the datagrams of a udp:// URL, from one sender or a multicast group."""

from __future__ import annotations

import errno
import ipaddress
import socket
import struct
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, urlsplit

BUFFER_BYTES = 8 << 20
EVERYWHERE = "0.0.0.0"
COUNT_OVERFLOWS = getattr(socket, "SO_RXQ_OVFL", 40)  # Linux's number; Python has no name for it
OVERFLOWS = struct.Struct("=I")
REMEDIES = {
    errno.EADDRINUSE: "another program receives there; end it, or have the video sent to another port",
    errno.EADDRNOTAVAIL: "no interface of this machine has the address; write udp://@:PORT for all of them",
    errno.ENODEV: "no interface leads to the group; name one by its address, as in ?localaddr=192.168.1.2",
}


@dataclass(frozen=True)
class DatagramAddress:
    """Where datagrams are received.

    Attributes:
        host: address of an interface, of a multicast group, or `EVERYWHERE`.
        port: the UDP port.
        local_address: address of the interface on which a group is joined; "" is the system's choice.
    """

    host: str
    port: int
    local_address: str = ""


def datagram_address(location: str) -> DatagramAddress:
    """The address in udp://[@]HOST:PORT[?localaddr=ADDRESS]; HOST may be empty.

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
    return DatagramAddress(parts.hostname or local_address or EVERYWHERE, parts.port, local_address)


def open_receiver(address: DatagramAddress) -> socket.socket:
    """A socket bound to the address, in the group if it is one, with a large buffer.

    Raises:
        OSError: with the remedy in its text.
    """
    try:
        family, _, _, _, target = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)[0]
        receiver = socket.socket(family, socket.SOCK_DGRAM)
        try:
            _prepare(receiver, target, address.local_address)
        except BaseException:
            receiver.close()
            raise
    except socket.gaierror:
        raise OSError(f"the host name {address.host!r} is not known here") from None
    except OSError as error:
        remedy = REMEDIES.get(error.errno or 0, "name another address or port")
        raise OSError(f"{error.strerror or error}: {remedy}") from None
    return receiver


def _prepare(receiver: socket.socket, target: tuple[Any, ...], local: str) -> None:
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
