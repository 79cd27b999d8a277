"""UDP sockets for an address given by name, and the packets of a transport stream in their datagrams."""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

PACKET_BYTES = 188  # ISO/IEC 13818-1, section 2.4.3
SocketAddress: TypeAlias = tuple[Any, ...]


def datagram_socket(
    host: str,
    port: int,
    prepare: Callable[[socket.socket, SocketAddress], None],
    remedies: Mapping[int, str],
    usual_remedy: str,
) -> socket.socket:
    """A socket of the family of an address, prepared for receiving there or for sending to it.

    Args:
        host: name or address.
        port: the port.
        prepare: binds or connects the socket to the address.
        remedies: of errors, by their errno.
        usual_remedy: of all other errors.

    Raises:
        OSError: with the remedy in its text.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        opened = socket.socket(family, socket.SOCK_DGRAM)
        try:
            prepare(opened, address)
        except BaseException:
            opened.close()
            raise
    except socket.gaierror:
        raise OSError(f"the host name {host!r} is not known here") from None
    except OSError as error:
        remedy = remedies.get(error.errno or 0, usual_remedy)
        raise OSError(f"{error.strerror or error}: {remedy}") from None
    return opened
