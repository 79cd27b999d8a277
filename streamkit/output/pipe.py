"""Pipes as outputs: the standard output, and waits for a reader that end."""

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

STANDARD_OUTPUT = "-"
LOOK_S = 0.05
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
class Patience:
    """How long to wait for a reader.

    Attributes:
        limit_s: the longest wait in which it takes nothing, s.
        stopping: set once there is to be no longer wait than a second.
        waiting: the context of a wait.
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


def open_fifo(path: Path, patience: Patience) -> int:
    """Opens a named pipe for writing as soon as something reads it; returns the descriptor.

    Raises:
        OSError: nothing reads it in time, or it cannot be opened.
    """
    began_s = time.monotonic()
    with patience.waiting():
        while True:
            try:
                return os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError as error:
                if error.errno != errno.ENXIO:
                    raise
            patience.check(began_s)
            time.sleep(LOOK_S)


def wait_writable(descriptor: int, patience: Patience) -> None:
    """Waits until a pipe takes `select.PIPE_BUF` bytes, or its reader has gone.

    Raises:
        TimeoutError: it does not within the limit.
    """
    poll, began_s = select.poll(), time.monotonic()
    poll.register(descriptor, select.POLLOUT)
    if poll.poll(0):
        return
    with patience.waiting():
        while not poll.poll(LOOK_S * 1000):
            patience.check(began_s)
