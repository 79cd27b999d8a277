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
        capacity: most pieces of work that wait; `offer` drops the oldest for a new one. 0 is no limit.
        periodic: called in the thread every `period_s`, between two pieces; the thread then begins at once.
        period_s: time between two calls, s.
    """

    def __init__(
        self,
        name: str,
        max_bytes: int,
        failed: Callable[[Exception], None],
        *,
        capacity: int = 0,
        periodic: Callable[[], object] | None = None,
        period_s: float = 1.0,
    ) -> None:
        self._name = name
        self._max_bytes = max_bytes
        self._failed = failed
        self._capacity = capacity
        self._periodic = periodic
        self._period_s = period_s
        self._waiting: deque[tuple[Callable[[], Any], Future[Any] | None, int]] = deque()
        self._changed = threading.Condition()
        self._bytes = 0
        self._is_closed = self._is_busy = self._is_stalled = False
        self._progress = 0
        self._thread: threading.Thread | None = None
        if periodic is not None:
            self._start()

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

    def offer(
        self, work: Callable[[], object], wait_s: float = 0.0, cancelled: threading.Event | None = None
    ) -> int:
        """Adds work that gives nothing back; at full capacity waits for room, then drops the oldest.

        After one wait in vain there is no further wait until a piece is done: an executor that is stuck costs
        its caller `wait_s` once.

        Args:
            work: called once, in the thread, unless it is dropped.
            wait_s: longest wait for room, s.
            cancelled: ends the wait when set, within half a second.

        Returns:
            How many pieces were dropped, 0 or 1.
        """
        with self._changed:
            deadline = time.monotonic() + (0.0 if self._is_stalled else wait_s)
            while self._is_full() and not (cancelled is not None and cancelled.is_set()):
                left_s = deadline - time.monotonic()
                if left_s <= 0:
                    break
                self._changed.wait(min(LOOK_S, left_s))
            self._is_stalled = self._is_full()
            if self._is_stalled:
                _, future, size = self._waiting.popleft()
                self._bytes -= size
                if future is not None:
                    future.cancel()
            self._append(work, None, 0)
            return int(self._is_stalled)

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
        self._wait_until(future.done, patience_s, cancelled)
        return future.done()

    def wait_idle(self, patience_s: float, cancelled: threading.Event | None = None) -> int:
        """Waits until all work is done, for as long as there is progress every `patience_s`.

        Returns:
            How many pieces are not done.
        """
        with self._changed:
            self._wait_until(lambda: not (self._waiting or self._is_busy), patience_s, cancelled)
            return len(self._waiting) + self._is_busy

    def report_progress(self) -> None:
        """Called by work now and then, so that `wait` goes on waiting.

        Raises:
            Abandoned: the executor was closed, and the result is not wanted any more.
        """
        self._progress += 1
        if self._is_closed:
            raise Abandoned(self._name)

    def abandon(self) -> int:
        """Drops work that has not begun and takes no more; how many pieces were dropped."""
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
        """Abandons what is not done; whether the thread has ended within the limit."""
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
        progress, deadline = self._progress, time.monotonic() + patience_s
        with self._changed:
            while not condition() and not (cancelled is not None and cancelled.is_set()):
                if self._progress != progress:
                    progress, deadline = self._progress, time.monotonic() + patience_s
                left_s = deadline - time.monotonic()
                if left_s <= 0:
                    break
                self._changed.wait(min(LOOK_S, left_s))

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
                return
        if future is not None:
            future.cancel()

    def _run(self) -> None:
        due = time.monotonic() + self._period_s
        while True:
            with self._changed:
                while not self._waiting and not self._is_closed:
                    left_s = LOOK_S if self._periodic is None else due - time.monotonic()
                    if left_s <= 0:
                        break
                    self._changed.wait(min(LOOK_S, left_s))
                if self._is_closed:
                    return
            if self._periodic is not None and time.monotonic() >= due:
                due = time.monotonic() + self._period_s
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
            if future is not None:
                future.set_result(result)
        except Abandoned:
            if future is not None:
                future.cancel()
        except Exception as error:
            if future is not None:
                future.set_exception(error)
            else:
                self._failed(error)
