"""The process's own network connections, found through Linux's /proc, so that one can be cut from outside.

FFmpeg looks at its time limit only, PyAV offers no other way to end a call under way, and neither hands out
the socket. Shutting it down from another thread ends any wait on it at once.
"""

from __future__ import annotations

import errno
import os
import socket
from pathlib import Path

DESCRIPTORS = Path("/proc/self/fd")


def refusal(host: str, port: int, limit_s: float) -> str:
    """Why no TCP connection can be made, in plain words; "" where one can.

    FFmpeg calls an unknown host an input/output error and an unreachable one invalid data.
    """
    try:
        with socket.create_connection((host, port), limit_s):
            return ""
    except socket.gaierror:
        return f"the host name {host!r} is not known here"
    except TimeoutError:
        return f"no connection to {host} port {port} within {limit_s:g} s"
    except OSError as error:
        return f"no connection to {host} port {port}: {error.strerror or error}"


def open_sockets() -> dict[str, int]:
    """The process's open sockets: a name unique to each, and its file descriptor."""
    found = {}
    for entry in os.listdir(DESCRIPTORS):
        try:
            target = os.readlink(DESCRIPTORS / entry)
        except OSError:
            continue  # closed meanwhile
        if target.startswith("socket:"):
            found[target] = int(entry)
    return found


def cut_connections(port: int, known: frozenset[str]) -> int:
    """Shuts down the TCP connections to a port that were opened after `known` was taken, also half-open ones.

    Args:
        port: of the other side.
        known: names of sockets to leave alone.

    Returns:
        How many were shut down.
    """
    count = 0
    for name, descriptor in open_sockets().items():
        if name not in known:
            count += _cut(name, descriptor, port)
    return count


def _cut(name: str, descriptor: int, port: int) -> int:
    try:
        duplicate = os.dup(descriptor)
    except OSError:
        return 0
    with socket.socket(fileno=duplicate) as connection:
        # The descriptor may have been closed and given to something else since it was listed.
        if os.readlink(DESCRIPTORS / str(duplicate)) != name or connection.type != socket.SOCK_STREAM:
            return 0
        try:
            if connection.getpeername()[1] != port:
                return 0
        except OSError as error:
            if error.errno != errno.ENOTCONN or connection.getsockopt(
                socket.SOL_SOCKET, socket.SO_ACCEPTCONN
            ):
                return 0
        try:
            connection.shutdown(socket.SHUT_RDWR)
        except OSError:
            return 0
        return 1
