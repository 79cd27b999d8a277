"""BackgroundExecutor: one thread that does pieces of work in order, so that the caller can go on."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

LOOK_S = 0.5  # longest sleep between looks, should a wake-up be missed

Result = TypeVar("Result")


class Abandoned(Exception):
    """The work is not wanted any more."""


class BackgroundExecutor:
    """Does the work it is given, in order, in a thread that begins with the first piece.

    `concurrent.futures.ThreadPoolExecutor` has no bound on the work that waits, and waits for all of it when
    it is closed; this one bounds the bytes that waiting work holds, and abandons what is not done.

    Args:
        name: of the thread.
        max_bytes: most bytes that work not done may hold; `do` then waits for room. One piece always fits.
        failed: called in the thread with what work raised whose result nobody has asked for.
    """

    def __init__(self, name: str, max_bytes: int, failed: Callable[[Exception], None]) -> None:
        self._name = name
        self._max_bytes = max_bytes
        self._failed = failed
        self._waiting: deque[tuple[Callable[[], Any], Future[Any] | None, int]] = deque()
        self._changed = threading.Condition()
        self._bytes = 0
        self._is_closed = False
        self._progress = 0
        self._thread: threading.Thread | None = None

    @property
    def waiting(self) -> int:
        """Pieces of work that have not begun."""
        return len(self._waiting)

    def do(self, work: Callable[[], object], size: int = 0, cancelled: threading.Event | None = None) -> None:
        """Adds work that gives nothing back; waits for room.

        Args:
            work: called once, in the thread.
            size: bytes that it holds until it is done.
            cancelled: ends the wait for room; the work is added all the same.
        """
        with self._changed:
            while self._waiting and self._bytes + size > self._max_bytes and not self._is_closed:
                if cancelled is not None and cancelled.is_set():
                    break
                self._changed.wait(LOOK_S)
        self._append(work, None, size)

    def ask(self, work: Callable[[], Result]) -> Future[Result]:
        """Adds work whose result, or exception, the future gets; it is cancelled where it is abandoned."""
        future: Future[Result] = Future()
        self._append(work, future, 0)
        return future

    def wait(self, future: Future[Any], patience_s: float, cancelled: threading.Event | None = None) -> bool:
        """Waits until a future is done, for as long as there is progress every `patience_s`.

        Returns:
            Whether it is done; False also where `cancelled` was set meanwhile.
        """
        progress, deadline = self._progress, time.monotonic() + patience_s
        with self._changed:
            while not future.done() and not (cancelled is not None and cancelled.is_set()):
                if self._progress != progress:
                    progress, deadline = self._progress, time.monotonic() + patience_s
                if time.monotonic() >= deadline:
                    break
                self._changed.wait(LOOK_S)
        return future.done()

    def report_progress(self) -> None:
        """Called by work now and then, so that `wait` goes on waiting.

        Raises:
            Abandoned: the executor was closed, and the result is not wanted any more.
        """
        self._progress += 1
        if self._is_closed:
            raise Abandoned(self._name)

    def close(self, limit_s: float) -> bool:
        """Abandons what is not done; whether the thread has ended within the limit."""
        with self._changed:
            self._is_closed = True
            dropped = [future for _, future, _ in self._waiting if future is not None]
            self._waiting.clear()
            self._changed.notify_all()
        for future in dropped:
            future.cancel()
        if self._thread is None:
            return True
        self._thread.join(limit_s)
        return not self._thread.is_alive()

    def _append(self, work: Callable[[], Any], future: Future[Any] | None, size: int) -> None:
        with self._changed:
            if not self._is_closed:
                self._waiting.append((work, future, size))
                self._bytes += size
                if self._thread is None:
                    self._thread = threading.Thread(target=self._run, name=self._name)
                    self._thread.start()
                self._changed.notify_all()
                return
        if future is not None:
            future.cancel()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._is_closed:
                    self._changed.wait(LOOK_S)
                if self._is_closed:
                    return
                work, future, size = self._waiting.popleft()
            self._perform(work, future)
            del work, future  # with what they hold, before the next wait
            with self._changed:
                self._bytes -= size
                self._progress += 1
                self._changed.notify_all()

    def _perform(self, work: Callable[[], Any], future: Future[Any] | None) -> None:
        try:
            result = work()
        except Abandoned:
            if future is not None:
                future.cancel()
        except Exception as error:
            if future is not None:
                future.set_exception(error)
            else:
                self._failed(error)
        else:
            if future is not None:
                future.set_result(result)
