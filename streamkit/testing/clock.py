"""A clock that only moves when a test advances it."""

from __future__ import annotations

import threading

POLL_S = 0.05


class ManualClock:
    """A clock that starts at `now_ns` and moves only by `advance`.

    Attributes:
        waiting: set while a thread waits for a future time.
    """

    def __init__(self, now_ns: int = 1_000_000_000) -> None:
        self._now_ns = now_ns
        self._moved = threading.Condition()
        self._deadlines: list[int] = []
        self.waiting = threading.Event()

    def monotonic_ns(self) -> int:
        """Current time, ns."""
        return self._now_ns

    def utc_ns(self) -> int:
        """Current time, ns, as time since 1970."""
        return self._now_ns

    def advance(self, seconds: float) -> None:
        """Advances the clock and wakes waiting threads."""
        with self._moved:
            self._now_ns += round(seconds * 1e9)
            self._update_waiting()
            self._moved.notify_all()

    def wait_until(self, deadline_ns: int, cancelled: threading.Event) -> bool:
        """Waits until the clock reaches the deadline; False if cancelled first."""
        with self._moved:
            self._deadlines.append(deadline_ns)
            self._update_waiting()
            while self._now_ns < deadline_ns and not cancelled.is_set():
                self._moved.wait(POLL_S)
            self._deadlines.remove(deadline_ns)
            self._update_waiting()
        return not cancelled.is_set()

    def _update_waiting(self) -> None:
        if any(deadline_ns > self._now_ns for deadline_ns in self._deadlines):
            self.waiting.set()
        else:
            self.waiting.clear()

    def wait_for_waiter(self, timeout_s: float = 5.0) -> bool:
        """Waits, in real time, until a thread waits on this clock."""
        return self.waiting.wait(timeout_s)
