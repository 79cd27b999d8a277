"""Clocks: monotonic time for pacing and ages, UTC for capture times."""

from __future__ import annotations

import threading
import time
from typing import Protocol

SECOND_NS = 1_000_000_000
# Times of one frame in two files differ by less: half of Matroska's millisecond, and the ticks of others.
CONTAINER_ROUNDING_NS = 600_000


class Clock(Protocol):
    """Interface of clocks; tests use `streamkit.testing.ManualClock`."""

    def monotonic_ns(self) -> int:
        """Monotonic time, ns."""

    def utc_ns(self) -> int:
        """Nanoseconds since 1970-01-01 UTC."""

    def wait_until(self, deadline_ns: int, cancelled: threading.Event) -> bool:
        """Waits until `monotonic_ns()` reaches the deadline; False if cancelled first."""


class SystemClock:
    """The system clock."""

    monotonic_ns = staticmethod(time.monotonic_ns)
    utc_ns = staticmethod(time.time_ns)

    def wait_until(self, deadline_ns: int, cancelled: threading.Event) -> bool:
        """Waits until the deadline; False if cancelled first."""
        while (left := deadline_ns - time.monotonic_ns()) > 0:
            if cancelled.wait(min(left / 1e9, 1.0)):
                return False
        return not cancelled.is_set()
