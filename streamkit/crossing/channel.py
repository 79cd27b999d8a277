"""Channel: messages and file descriptors over a Unix socket, in order."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import threading
from collections import deque
from collections.abc import Callable, Sequence

LENGTH = struct.Struct("<I")
MAX_MESSAGE = 1 << 28  # bytes; a longer one is not read, so that the other side cannot exhaust memory
READ_BYTES = 1 << 16
DESCRIPTOR = struct.Struct("i")
ANCILLARY_BYTES = socket.CMSG_SPACE(64 * DESCRIPTOR.size)
POLL_S = 0.2  # interval at which waits check whether they are cancelled
TIMEOUT = struct.pack("@ll", 0, int(POLL_S * 1e6))  # as the kernel has it: s, us


class ChannelClosed(Exception):
    """The other side has closed the channel, or its process has ended."""


class Channel:
    """One end of a connected pair; one thread reads, any thread writes.

    Args:
        end: a connected Unix stream socket, which the channel then owns.

    Attributes:
        is_closed: whether the end of the other side was noticed.
    """

    def __init__(self, end: socket.socket) -> None:
        end.settimeout(None)  # the kernel's limits spare a call of poll before each transfer
        for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
            end.setsockopt(socket.SOL_SOCKET, option, TIMEOUT)
        self.is_closed = False
        self._socket = end
        self._lock = threading.Lock()
        self._buffer = memoryview(bytearray(READ_BYTES))
        self._received = bytearray()  # of messages that are not complete
        self._descriptors: deque[int] = deque()

    @staticmethod
    def pair() -> tuple[socket.socket, socket.socket]:
        """Two connected sockets, one for each process."""
        return socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)

    def send(
        self,
        message: bytes,
        descriptors: Sequence[int] = (),
        is_cancelled: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Sends a message of at most 256 MiB, and copies of at most 64 descriptors; waits for a full socket.

        Returns:
            False if it was cancelled before its first byte. A message that has begun then closes the channel,
            because what follows could not be read.

        Raises:
            ChannelClosed: the other side has ended.
        """
        if len(message) > MAX_MESSAGE:
            raise ValueError(f"a message has at most {MAX_MESSAGE} bytes, got {len(message)}")
        data: bytes | memoryview = LENGTH.pack(len(message)) + message
        has_begun = False
        while not self._lock.acquire(timeout=POLL_S):  # another thread may wait for a full socket
            if is_cancelled():
                return False
        try:
            while data:
                try:
                    if descriptors and not has_begun:
                        sent = socket.send_fds(self._socket, [data], descriptors)
                    else:
                        sent = self._socket.send(data)
                except BlockingIOError:
                    if is_cancelled():
                        if has_begun:
                            self.shut_down()
                        return False
                except OSError:
                    raise self._closed() from None
                else:
                    has_begun = True
                    data = memoryview(data)[sent:]
        finally:
            self._lock.release()
        return True

    def receive(self) -> list[bytes]:
        """The complete messages that have arrived, after at most `POLL_S`.

        Raises:
            ChannelClosed: the other side has ended, and every message before that was returned.
        """
        try:
            size, ancillary, _, _ = self._socket.recvmsg_into(
                [self._buffer], ANCILLARY_BYTES, socket.MSG_CMSG_CLOEXEC
            )
        except BlockingIOError:
            return []
        except OSError:
            raise self._closed() from None
        for _, _, descriptors in ancillary:  # of no other kind on a Unix socket
            self._descriptors.extend(number for (number,) in DESCRIPTOR.iter_unpack(descriptors))
        if not size:
            raise self._closed()
        self._received += self._buffer[:size]
        return self._take()

    def take_descriptor(self) -> int:
        """The oldest descriptor received and not taken yet; the caller closes it.

        Raises:
            ValueError: there is none.
            ChannelClosed: `close` was called since.
        """
        try:
            return self._descriptors.popleft()
        except IndexError:
            if self._socket.fileno() < 0:
                raise self._closed() from None
            raise ValueError("a message announces a descriptor that has not come") from None

    def shut_down(self) -> None:
        """Makes both sides see the end; safe in any thread."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Closes the socket and the descriptors that were not taken; a thread that reads sees the end."""
        self._socket.close()
        with contextlib.suppress(IndexError):
            while True:
                os.close(self._descriptors.popleft())

    def _closed(self) -> ChannelClosed:
        self.is_closed = True
        return ChannelClosed()

    def _take(self) -> list[bytes]:
        received, at = self._received, 0
        messages = []
        while at + LENGTH.size <= len(received):
            (length,) = LENGTH.unpack_from(received, at)
            if length > MAX_MESSAGE:
                raise self._closed()
            end = at + LENGTH.size + length
            if end > len(received):
                break
            messages.append(bytes(received[at + LENGTH.size : end]))
            at = end
        if at:
            del received[:at]
        return messages
