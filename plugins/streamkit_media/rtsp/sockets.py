"""The process's own sockets, found through Linux's /proc, so that a connection can be shut down from outside.

FFmpeg looks at its time limit only, PyAV offers no other way to end a call under way, and neither hands out
the socket. Shutting it down from another thread ends any wait on it at once.
"""

from __future__ import annotations

import errno
import os
import socket
import threading
from pathlib import Path

DESCRIPTORS = Path("/proc/self/fd")
TCP_INFO_BYTES = 8
TCP_ESTABLISHED = 1


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


class Claims:
    """Which sockets belong to which connection, so that two to the same server do not cut each other."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._of: dict[object, frozenset[str]] = {}

    def claim(self, owner: object, port: int, known: frozenset[str]) -> frozenset[str]:
        """Assigns an owner the sockets to a port that were opened after `known` and have no owner."""
        with self._lock:
            taken = known.union(*self._of.values())
            found = {name for name, number in open_sockets().items() if name not in taken}
            mine = frozenset(name for name in found if leads_to(name, port))
            self._of[owner] = mine
            return mine

    def of_others(self, owner: object) -> frozenset[str]:
        """The sockets of all other owners."""
        with self._lock:
            return frozenset().union(*(names for other, names in self._of.items() if other is not owner))

    def release(self, owner: object) -> None:
        """Removes the owner's sockets."""
        with self._lock:
            self._of.pop(owner, None)


CLAIMS = Claims()


def leads_to(name: str, port: int) -> bool:
    """Whether an open socket is connected to a port."""
    connection = duplicate(name)
    if connection is None:
        return False
    with connection:
        try:
            return bool(connection.type == socket.SOCK_STREAM and connection.getpeername()[1] == port)
        except (OSError, IndexError, TypeError):
            return False


def is_closed_by_peer(names: frozenset[str]) -> bool:
    """Whether the other side has closed one of these TCP connections."""
    for name in names:
        connection = duplicate(name)
        if connection is None:
            continue
        with connection:
            try:
                info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, TCP_INFO_BYTES)
            except OSError:
                continue
            if info[0] != TCP_ESTABLISHED:
                return True
    return False


def cut_connections(port: int, known: frozenset[str]) -> int:
    """Shuts down the TCP connections to a port, also half-open ones, except `known`; returns their number."""
    return sum(_cut(name, port) for name in open_sockets() if name not in known)


def duplicate(name: str) -> socket.socket | None:
    """A socket of our own on the same connection; None if it was closed meanwhile."""
    number = open_sockets().get(name)
    if number is None:
        return None
    try:
        duplicate = os.dup(number)
    except OSError:
        return None
    try:
        # The descriptor may have been closed and given to something else since it was listed.
        if os.readlink(DESCRIPTORS / str(duplicate)) == name:
            return socket.socket(fileno=duplicate)
    except OSError:
        pass
    os.close(duplicate)
    return None


def _cut(name: str, port: int) -> int:
    connection = duplicate(name)
    if connection is None:
        return 0
    with connection:
        if connection.type != socket.SOCK_STREAM or connection.family not in (
            socket.AF_INET,
            socket.AF_INET6,
        ):
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
