"""UDP: addresses, udp://[@]HOST:PORT, and the sockets that receive there or send there."""

from __future__ import annotations

import errno
import ipaddress
import socket
import struct
from dataclasses import dataclass
from typing import Any, TypeAlias
from urllib.parse import parse_qsl, urlsplit

PACKET_BYTES = 188  # of a transport stream (ISO/IEC 13818-1, section 2.4.3)
RECEIVE_BUFFER_BYTES = 8 << 20
SEND_BUFFER_BYTES = 1 << 20  # a keyframe of high quality
EVERYWHERE = "0.0.0.0"
SHORT_TTL, MAX_TTL = 1, 255
COUNT_OVERFLOWS = getattr(socket, "SO_RXQ_OVFL", 40)  # Linux's number; Python has no name for it
OVERFLOWS = struct.Struct("=I")
REMEDIES = {
    errno.EADDRINUSE: "another program receives there; end it, or have the video sent to another port",
    errno.EADDRNOTAVAIL: "no interface of this machine has the address; write udp://@:PORT for all of them",
    errno.ENODEV: "no interface leads to the group; name one by its address, as in ?localaddr=192.168.1.2",
}
SocketAddress: TypeAlias = tuple[Any, ...]
IpAddress: TypeAlias = ipaddress.IPv4Address | ipaddress.IPv6Address


@dataclass(frozen=True, slots=True)
class UdpAddress:
    """udp://[@]HOST:PORT[?localaddr=ADDRESS][&ttl=HOPS]."""

    host: str  # of a receiver or an interface, or a multicast group; "" is every interface
    port: int
    local: str = ""  # address of the interface to join a group on or to send from; "" for the system's choice
    ttl: int = SHORT_TTL  # how many networks a datagram to a group crosses


def source_address(location: str) -> UdpAddress:
    """The address to receive at; raises `ValueError` where the URL is none."""
    address, fields = _parsed(location)
    if not address.port:
        raise ValueError("the port is missing; write udp://@:PORT")
    if fields:
        names = ", ".join(sorted(fields))
        raise ValueError(f"it takes ?localaddr=ADDRESS only, not {names}; write udp://@:PORT without it")
    return address


def target_address(location: str) -> UdpAddress:
    """The address to send to; raises `ValueError` where the URL is none."""
    address, fields = _parsed(location)
    ttl = fields.pop("ttl", str(SHORT_TTL))
    if not address.host or not address.port:
        raise ValueError("the host or the port is missing")
    if fields or not ttl.isdecimal() or not 1 <= int(ttl) <= MAX_TTL:
        raise ValueError(f"it takes ?localaddr=ADDRESS and ttl= from 1 to {MAX_TTL} only")
    return UdpAddress(address.host, address.port, address.local, int(ttl))


def _parsed(location: str) -> tuple[UdpAddress, dict[str, str]]:
    parts = urlsplit(location)
    fields = dict(parse_qsl(parts.query, keep_blank_values=True))
    local = fields.pop("localaddr", "")
    return UdpAddress(parts.hostname or "", parts.port or 0, local), fields


def open_receiver(address: UdpAddress) -> socket.socket:
    """A socket bound to an address, in the group if it is one; `overflows` reads what the kernel drops.

    Raises:
        OSError: with the remedy in its text.
    """
    receiver, place, group = _open(address.host or address.local or EVERYWHERE, address.port)
    try:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        receiver.setsockopt(socket.SOL_SOCKET, COUNT_OVERFLOWS, 1)
        if group is not None:  # else a second receiver of the port would take the datagrams from the first
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        receiver.bind(place)  # to the group, as the port alone would bring other groups too
        if isinstance(group, ipaddress.IPv4Address):
            interface = socket.inet_aton(address.local or EVERYWHERE)
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group.packed + interface)
        elif group is not None:
            scope = struct.pack("=I", place[3] if len(place) == 4 else 0)
            receiver.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, group.packed + scope)
    except OSError as error:
        receiver.close()
        remedy = REMEDIES.get(error.errno or 0, "name another address or port")
        raise OSError(f"{error.strerror or error}: {remedy}") from None
    return receiver


def open_sender(address: UdpAddress) -> socket.socket:
    """A socket that sends to an address.

    Raises:
        OSError: with the remedy in its text.
    """
    sender, place, group = _open(address.host, address.port)
    try:
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        if address.local:
            sender.bind((address.local, 0))
        if isinstance(group, ipaddress.IPv4Address):
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, address.ttl)
            interface = socket.inet_aton(address.local or EVERYWHERE)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
        elif group is not None:
            sender.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, address.ttl)
        sender.connect(place)
    except OSError as error:
        sender.close()
        remedy = "check the address, and that of the interface"
        raise OSError(f"{error.strerror or error}: {remedy}") from None
    return sender


def _open(host: str, port: int) -> tuple[socket.socket, SocketAddress, IpAddress | None]:
    """A socket of the family of an address, the address resolved, and the group if it is one."""
    try:
        family, _, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except socket.gaierror:
        raise OSError(f"the host name {host!r} is not known here") from None
    ip_address = ipaddress.ip_address(str(place[0]).partition("%")[0])
    opened = socket.socket(family, socket.SOCK_DGRAM)
    return opened, place, ip_address if ip_address.is_multicast else None


def overflows(ancillary: list[tuple[int, int, bytes]]) -> int:
    """Datagrams that the kernel has dropped since the socket was opened; 0 where it does not say."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, COUNT_OVERFLOWS) and len(data) == OVERFLOWS.size:
            return int(OVERFLOWS.unpack(data)[0])
    return 0
