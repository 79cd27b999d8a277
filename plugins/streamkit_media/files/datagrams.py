"""Waiting for the first datagram of a UDP stream, which FFmpeg does not let one end."""

from __future__ import annotations

import ipaddress
import select
import socket
import threading
import time
from urllib.parse import urlsplit

LOOK_EVERY_S = 0.1


def await_datagram(location: str, limit_s: float, cancelled: threading.Event) -> bool:
    """Whether a datagram for a `udp://` URL has come within the limit; False also where it is cancelled.

    Raises:
        OSError: the port or the group cannot be used.
    """
    parts = urlsplit(location)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        receiver.bind(("", parts.port or 0))
        if is_group(parts.hostname or ""):
            group = socket.inet_aton(parts.hostname or "") + socket.inet_aton("0.0.0.0")
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        deadline_s = time.monotonic() + limit_s
        while not cancelled.is_set() and time.monotonic() < deadline_s:
            if select.select([receiver], [], [], LOOK_EVERY_S)[0]:
                return True
    return False


def is_group(host: str) -> bool:
    """Whether a host is a multicast group."""
    try:
        return ipaddress.ip_address(host).is_multicast
    except ValueError:
        return False
