"""Pipes: the standard output, and waits for its reader, each with a limit."""

from __future__ import annotations

import contextlib
import errno
import functools
import os
import select
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

STANDARD_INPUT = STANDARD_OUTPUT = "-"  # as a location
POLL_S = 0.05
STOP_LIMIT_S = 1.0


@functools.cache
def standard_output() -> int:
    """The descriptor of the standard output, which from now on is that of an output alone.

    Whatever else this process prints goes to stderr: one line of text would damage a stream of video.
    """
    descriptor = os.dup(1)
    os.dup2(2, 1)
    return descriptor


@contextlib.contextmanager
def until_reader_leaves() -> Iterator[None]:
    """Context that ends without an error when the reader of the standard output leaves, as `head` does."""
    try:
        yield
    except Exception as error:
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, BrokenPipeError):
            cause = cause.__cause__
        if cause is None:
            raise
        # Python would report an error when it flushes stdout at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


@dataclass(frozen=True)
class ReaderWait:
    """How long to wait for a reader.

    Attributes:
        limit_s: the longest wait in which it takes nothing, s.
        stopping: when it is set, a wait ends after a second.
        waiting: context that is entered while waiting.
    """

    limit_s: float = 10.0
    stopping: threading.Event = field(default_factory=threading.Event)
    waiting: Callable[[], AbstractContextManager[object]] = nullcontext

    def check(self, began_s: float) -> None:
        """Checks a wait that began at a time of the monotonic clock.

        Raises:
            TimeoutError: it is too long.
        """
        limit_s = min(STOP_LIMIT_S, self.limit_s) if self.stopping.is_set() else self.limit_s
        if time.monotonic() - began_s > limit_s:
            raise TimeoutError(errno.ETIMEDOUT, f"its reader has taken nothing for {limit_s:g} s")


def open_fifo(path: Path, reader_wait: ReaderWait) -> int:
    """Opens a named pipe for writing as soon as something reads it; returns the descriptor.

    Raises:
        OSError: nothing reads it in time, or it cannot be opened.
    """
    began_s = time.monotonic()
    with reader_wait.waiting():
        while True:
            try:
                return os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError as error:
                if error.errno != errno.ENXIO:
                    raise
            reader_wait.check(began_s)
            time.sleep(POLL_S)


def wait_writable(descriptor: int, reader_wait: ReaderWait) -> None:
    """Waits until a pipe takes `select.PIPE_BUF` bytes, or its reader has gone.

    Raises:
        TimeoutError: it does not within the limit.
    """
    poll, began_s = select.poll(), time.monotonic()
    poll.register(descriptor, select.POLLOUT)
    if poll.poll(0):
        return
    with reader_wait.waiting():
        while not poll.poll(POLL_S * 1000):
            reader_wait.check(began_s)
