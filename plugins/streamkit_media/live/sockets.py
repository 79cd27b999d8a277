"""The process's own sockets, found through Linux's /proc, so that a connection can be shut down from outside.

FFmpeg looks at its time limit only, PyAV offers no other way to end a call under way, and neither hands out
the socket. Shutting it down from another thread ends any wait on it at once.
"""

from __future__ import annotations

import errno
import os
import socket
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

DESCRIPTORS = Path("/proc/self/fd")
TCP_INFO_BYTES = 8
TCP_ESTABLISHED = 1
FAMILIES = (socket.AF_INET, socket.AF_INET6)
IS_LISTENING = (socket.SOL_SOCKET, socket.SO_ACCEPTCONN)


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
            found = _duplicates(open_sockets().keys() - taken)
            mine = frozenset(name for name, connection in found if _leads_to(connection, port))
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


def is_closed_by_peer(names: frozenset[str]) -> bool:
    """Whether the other side has closed one of these TCP connections."""
    return any(_state(connection) != TCP_ESTABLISHED for _, connection in _duplicates(names))


def cut_connections(port: int, known: frozenset[str]) -> int:
    """Shuts down the TCP connections to a port, also half-open ones, except `known`; returns their number."""
    return sum(_cut(connection, port) for _, connection in _duplicates(open_sockets().keys() - known))


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


def _duplicates(names: Iterable[str]) -> Iterator[tuple[str, socket.socket]]:
    """The sockets of these names that are still open, each closed when the next is asked for."""
    for name in names:
        if (connection := duplicate(name)) is not None:
            with connection:
                yield name, connection


def _leads_to(connection: socket.socket, port: int, *, or_is_half_open: bool = False) -> bool:
    """Whether a socket is a TCP connection to a port."""
    if connection.type != socket.SOCK_STREAM or connection.family not in FAMILIES:
        return False
    try:
        return bool(connection.getpeername()[1] == port)
    except OSError as error:
        is_half_open = error.errno == errno.ENOTCONN and not connection.getsockopt(*IS_LISTENING)
        return or_is_half_open and is_half_open


def _state(connection: socket.socket) -> int:
    try:
        return connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, TCP_INFO_BYTES)[0]
    except OSError:
        return TCP_ESTABLISHED


def _cut(connection: socket.socket, port: int) -> bool:
    try:
        if not _leads_to(connection, port, or_is_half_open=True):
            return False
        connection.shutdown(socket.SHUT_RDWR)
    except OSError:
        return False
    return True
