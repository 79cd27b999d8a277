"""A thread that does one thing after the other, so that whoever hands the work over can go on."""

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Final, TypeVar

_LOOK_S: Final = 0.5

Result = TypeVar("Result")


class Abandoned(Exception):
    """The work is not wanted any more."""


class Worker:
    """Does what it is handed, in order, in a thread that begins with the first work.

    Args:
        name: of the thread.
        capacity: most bytes that wait; who would hand over more waits for room. One piece always fits.
        failed: called in the worker's thread with what work raised for whose result nobody asks.
    """

    def __init__(self, name: str, capacity: int, failed: Callable[[Exception], None]) -> None:
        self._name = name
        self._capacity = capacity
        self._failed = failed
        self._waiting: deque[tuple[Callable[[], Any], Future[Any] | None, int]] = deque()
        self._changed = threading.Condition()
        self._bytes = 0
        self._is_closed = False
        self._progress = 0
        self._thread: threading.Thread | None = None

    @property
    def waiting(self) -> int:
        """Pieces of work that were handed over and have not begun."""
        return len(self._waiting)

    def do(self, work: Callable[[], object], size: int = 0, cancelled: threading.Event | None = None) -> None:
        """Hands over work that gives nothing back.

        Args:
            work: called once, in the worker's thread.
            size: bytes that it holds until it is done.
            cancelled: ends the wait for room; the work is lined up all the same.
        """
        with self._changed:
            while self._waiting and self._bytes + size > self._capacity and not self._is_closed:
                if cancelled is not None and cancelled.is_set():
                    break
                self._changed.wait(_LOOK_S)
        self._line_up(work, None, size)

    def ask(self, work: Callable[[], Result]) -> "Future[Result]":
        """Hands over work whose result, or exception, the future has; cancelled where it is abandoned."""
        future: Future[Result] = Future()
        self._line_up(work, future, 0)
        return future

    def wait(
        self, future: "Future[Any]", patience_s: float, cancelled: threading.Event | None = None
    ) -> bool:
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
                self._changed.wait(_LOOK_S)
        return future.done()

    def breathe(self) -> None:
        """Called by work now and then: it is getting on.

        Raises:
            Abandoned: nobody wants its result any more.
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

    def _line_up(self, work: Callable[[], Any], future: "Future[Any] | None", size: int) -> None:
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
                    self._changed.wait(_LOOK_S)
                if self._is_closed:
                    return
                work, future, size = self._waiting.popleft()
            self._perform(work, future)
            # Let go of before the next wait, with what it holds.
            del work, future
            with self._changed:
                self._bytes -= size
                self._progress += 1
                self._changed.notify_all()

    def _perform(self, work: Callable[[], Any], future: "Future[Any] | None") -> None:
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
