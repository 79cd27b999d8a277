"""The machine's clock."""

import threading
import time

from streamkit.flow.clock import SystemClock


def test_a_deadline_that_has_passed_is_not_waited_for() -> None:
    """True at once, so that a late frame is shown at once."""
    assert SystemClock().wait_until(0, threading.Event())


def test_a_wait_can_be_cancelled() -> None:
    """False where the pipeline stops before the deadline, however far that is."""
    cancelled = threading.Event()
    cancelled.set()
    clock = SystemClock()
    assert not clock.wait_until(clock.monotonic_ns() + 10**12, cancelled)
    assert not clock.wait_until(0, cancelled)


def test_clocks_are_those_of_the_machine() -> None:
    """Monotonic for ages, UTC for capture times."""
    clock = SystemClock()
    assert abs(clock.monotonic_ns() - time.monotonic_ns()) < 10**10
    assert abs(clock.utc_ns() - time.time_ns()) < 10**10
