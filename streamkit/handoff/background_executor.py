"""BackgroundExecutor: one thread that runs tasks in order."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from streamkit.handoff.bounded_queue import wait_until

Result = TypeVar("Result")
PERIOD_S = 1.0


class Abandoned(Exception):
    """The executor was closed; the result of the task is not needed."""


class BackgroundExecutor:
    """Runs tasks in order in one thread, which starts with the first task.

    Unlike `concurrent.futures.ThreadPoolExecutor` it bounds the queued tasks, and abandons them when closed.
    `submit` has a result and no bound, `submit_waiting` waits for room, `submit_dropping` makes room.

    Args:
        name: of the thread.
        failed: called in the thread with the exception of a task without a future.
        max_bytes: maximum size of unfinished tasks, for `submit_waiting`; 0 is no limit. One always fits.
        capacity: maximum number of queued tasks, for `submit_dropping`; 0 is no limit.
        periodic: called in the thread once a second, between tasks; the thread then starts at once.
    """

    def __init__(
        self,
        name: str,
        failed: Callable[[Exception], None],
        *,
        max_bytes: int = 0,
        capacity: int = 0,
        periodic: Callable[[], object] | None = None,
    ) -> None:
        self._name = name
        self._max_bytes = max_bytes
        self._failed = failed
        self._capacity = capacity
        self._periodic = periodic
        self._waiting: deque[tuple[Callable[[], Any], Future[Any] | None, int]] = deque()
        self._changed = threading.Condition()
        self._bytes = 0
        self._is_closed = self._is_busy = self._is_stalled = False
        self._progress = 0
        self._thread: threading.Thread | None = None
        if periodic is not None:
            self._start()

    def submit_waiting(
        self, work: Callable[[], object], size: int = 0, cancelled: threading.Event | None = None
    ) -> None:
        """Adds a task without a result, which holds `size` bytes until it has finished; waits for room.

        A cancelled wait adds the task nevertheless.
        """
        with self._changed:
            wait_until(
                self._changed,
                lambda: self._is_closed or not (self._waiting and 0 < self._max_bytes < self._bytes + size),
                None,
                cancelled,
            )
            self._append(work, None, size)

    def submit_dropping(
        self, work: Callable[[], object], wait_s: float = 0.0, cancelled: threading.Event | None = None
    ) -> int:
        """Adds a task without a result; at full capacity waits for room, then drops the oldest.

        After a timeout there is no further wait until a task finishes: a stuck executor costs `wait_s` once.
        The wait ends within half a second once `cancelled` is set. Returns the number of dropped tasks.
        """
        with self._changed:
            limit_s = 0.0 if self._is_stalled else wait_s
            wait_until(self._changed, lambda: not self._is_full(), limit_s, cancelled)
            self._is_stalled = self._is_full()
            if self._is_stalled:
                _, future, size = self._waiting.popleft()
                self._bytes -= size
                if future is not None:
                    future.cancel()
            self._append(work, None, 0)
            return int(self._is_stalled)

    def submit(self, work: Callable[[], Result]) -> Future[Result]:
        """Adds a task; the future gets its result or exception, and is cancelled if it is abandoned."""
        future: Future[Result] = Future()
        self._append(work, future, 0)
        return future

    def wait(self, future: Future[Any], patience_s: float, cancelled: threading.Event | None = None) -> bool:
        """Waits until a future is done, `patience_s` without progress, or cancelled; whether it is done."""
        self._wait_until(future.done, patience_s, cancelled)
        return future.done()

    def wait_idle(self, patience_s: float, cancelled: threading.Event | None = None) -> int:
        """Waits until all tasks have finished; the number of those that have not, as for `wait`."""
        with self._changed:
            self._wait_until(lambda: not (self._waiting or self._is_busy), patience_s, cancelled)
            return len(self._waiting) + self._is_busy

    def report_progress(self) -> None:
        """Called by a long task from time to time, so that `wait` does not give up.

        Raises:
            Abandoned: the executor was closed.
        """
        self._progress += 1
        if self._is_closed:
            raise Abandoned(self._name)

    def abandon(self) -> int:
        """Drops queued tasks and refuses new ones; returns the number dropped."""
        with self._changed:
            self._is_closed = True
            dropped = list(self._waiting)
            self._waiting.clear()
            self._changed.notify_all()
        for _, future, _ in dropped:
            if future is not None:
                future.cancel()
        return len(dropped)

    def close(self, limit_s: float) -> bool:
        """Abandons queued tasks; whether the thread has ended within the limit."""
        self.abandon()
        if self._thread is None:
            return True
        self._thread.join(limit_s)
        return not self._thread.is_alive()

    def _is_full(self) -> bool:
        return 0 < self._capacity <= len(self._waiting)

    def _wait_until(
        self, condition: Callable[[], bool], patience_s: float, cancelled: threading.Event | None
    ) -> None:
        before = -1

        def is_done_or_further() -> bool:
            return condition() or self._progress != before

        with self._changed:
            while self._progress != before and not condition():
                before = self._progress
                wait_until(self._changed, is_done_or_further, patience_s, cancelled)

    def _start(self) -> None:
        self._thread = threading.Thread(target=self._run, name=self._name)
        self._thread.start()

    def _append(self, work: Callable[[], Any], future: Future[Any] | None, size: int) -> None:
        with self._changed:
            if not self._is_closed:
                self._waiting.append((work, future, size))
                self._bytes += size
                if self._thread is None:
                    self._start()
                self._changed.notify_all()
            elif future is not None:
                future.cancel()

    def _run(self) -> None:
        due = time.monotonic() + PERIOD_S
        while True:
            with self._changed:
                left_s = None if self._periodic is None else due - time.monotonic()
                wait_until(self._changed, lambda: bool(self._waiting) or self._is_closed, left_s)
                if self._is_closed:
                    return
            if self._periodic is not None and time.monotonic() >= due:
                due = time.monotonic() + PERIOD_S
                self._perform(self._periodic, None)
            self._do_next()

    def _do_next(self) -> None:
        with self._changed:
            if not self._waiting:
                return
            work, future, size = self._waiting.popleft()
            self._is_busy = True
            self._changed.notify_all()
        self._perform(work, future)
        del work, future  # with what they hold, before the next wait
        with self._changed:
            self._bytes -= size
            self._progress += 1
            self._is_busy = self._is_stalled = False
            self._changed.notify_all()

    def _perform(self, work: Callable[[], Any], future: Future[Any] | None) -> None:
        try:
            result = work()
        except Abandoned:
            if future is not None:
                future.cancel()
        except Exception as error:
            if future is None:
                self._failed(error)
            else:
                future.set_exception(error)
        else:
            if future is not None:
                future.set_result(result)
