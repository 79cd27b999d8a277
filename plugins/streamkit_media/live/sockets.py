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


class ConnectionSockets:
    """The sockets of one connection that FFmpeg makes: those to its port that are opened from now on.

    Two connections to the same server do not cut each other: what one has claimed, the others leave alone.
    """

    _lock = threading.Lock()
    _claims: dict[ConnectionSockets, frozenset[str]] = {}  # noqa: RUF012 - of all connections of the process

    def __init__(self, port: int) -> None:
        self._port = port
        self._known = frozenset(_open_sockets())
        self._names: frozenset[str] = frozenset()

    def claim(self) -> None:
        """Takes the sockets that the connection, which is complete now, consists of."""
        with self._lock:
            found = _duplicates(_open_sockets().keys() - self._known.union(*self._claims.values()))
            self._names = frozenset(name for name, connection in found if _leads_to(connection, self._port))
            self._claims[self] = self._names

    def release(self) -> None:
        """Gives up the claim to the sockets, which the container has closed."""
        with self._lock:
            self._claims.pop(self, None)

    def cut(self) -> int:
        """Shuts the connection down, also one that is half open; returns the number of its sockets."""
        with self._lock:
            others = [names for other, names in self._claims.items() if other is not self]
        found = _duplicates(_open_sockets().keys() - self._known.union(*others))
        return sum(_cut(connection, self._port) for _, connection in found)

    def is_closed_by_peer(self) -> bool:
        """Whether the other side has closed the connection."""
        return any(_state(connection) != TCP_ESTABLISHED for _, connection in _duplicates(self._names))

    def duplicate(self) -> socket.socket | None:
        """A socket of our own on the same connection; None where it is closed, or is not one socket alone."""
        return _duplicate(*self._names) if len(self._names) == 1 else None


def _open_sockets() -> dict[str, int]:
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


def _duplicate(name: str) -> socket.socket | None:
    number = _open_sockets().get(name)
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
        if (connection := _duplicate(name)) is not None:
            with connection:
                yield name, connection


def _leads_to(connection: socket.socket, port: int, *, or_is_half_open: bool = False) -> bool:
    """Whether a socket is a TCP connection to a port."""
    if connection.type != socket.SOCK_STREAM or connection.family not in FAMILIES:
        return False
    try:
        return bool(connection.getpeername()[1] == port)
    except OSError as error:
        is_listening = connection.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
        return or_is_half_open and error.errno == errno.ENOTCONN and not is_listening


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
