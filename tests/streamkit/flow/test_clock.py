"""SystemClock."""

import threading
import time

from streamkit.flow.clock import SystemClock


def test_a_past_deadline_returns_at_once() -> None:
    """True."""
    assert SystemClock().wait_until(0, threading.Event())


def test_a_wait_can_be_cancelled() -> None:
    """The result is False."""
    cancelled = threading.Event()
    cancelled.set()
    clock = SystemClock()
    assert not clock.wait_until(clock.monotonic_ns() + 10**12, cancelled)
    assert not clock.wait_until(0, cancelled)


def test_clocks_of_the_system() -> None:
    """Monotonic time for ages, UTC for capture times."""
    clock = SystemClock()
    assert abs(clock.monotonic_ns() - time.monotonic_ns()) < 10**10
    assert abs(clock.utc_ns() - time.time_ns()) < 10**10
