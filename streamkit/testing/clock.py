"""A clock that stands still until a test moves it."""

from __future__ import annotations

import threading
import time

POLL_S = 0.05


class ManualClock:
    """Starts at `now_ns` and moves only by `advance`; waits end when their time has come.

    Attributes:
        waiting: set while something waits for a time that has not come.
    """

    def __init__(self, now_ns: int = 1_000_000_000) -> None:
        self._now_ns = now_ns
        self._moved = threading.Condition()
        self._deadlines: list[int] = []
        self.waiting = threading.Event()

    def monotonic_ns(self) -> int:
        """The time set, ns."""
        return self._now_ns

    def utc_ns(self) -> int:
        """The same time, as if it had begun in 1970."""
        return self._now_ns

    def advance(self, seconds: float) -> None:
        """Moves the clock and wakes whoever waits."""
        with self._moved:
            self._now_ns += round(seconds * 1e9)
            self._tell()
            self._moved.notify_all()

    def wait_until(self, deadline_ns: int, cancelled: threading.Event) -> bool:
        """Waits until the clock has been moved to the deadline; False if cancelled before."""
        with self._moved:
            self._deadlines.append(deadline_ns)
            self._tell()
            while self._now_ns < deadline_ns and not cancelled.is_set():
                self._moved.wait(POLL_S)
            self._deadlines.remove(deadline_ns)
            self._tell()
        return not cancelled.is_set()

    def _tell(self) -> None:
        if any(deadline_ns > self._now_ns for deadline_ns in self._deadlines):
            self.waiting.set()
        else:
            self.waiting.clear()

    def wait_for_waiter(self, timeout_s: float = 5.0) -> bool:
        """Waits, in real time, until something waits on this clock."""
        deadline = time.monotonic() + timeout_s
        return self.waiting.wait(max(0.0, deadline - time.monotonic()))
