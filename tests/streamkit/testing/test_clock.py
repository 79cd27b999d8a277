"""ManualClock."""

import threading

from streamkit.testing import ManualClock


def test_the_clock_moves_only_by_advance() -> None:
    """Both readings."""
    clock = ManualClock(5)
    assert (clock.monotonic_ns(), clock.utc_ns()) == (5, 5)
    clock.advance(1.5)
    assert (clock.monotonic_ns(), clock.utc_ns()) == (1_500_000_005, 1_500_000_005)


def test_a_wait_ends_at_its_deadline() -> None:
    """Or at once after it."""
    clock, cancelled = ManualClock(0), threading.Event()
    ended: list[bool] = []
    waiting = threading.Thread(target=lambda: ended.append(clock.wait_until(2_000_000_000, cancelled)))
    waiting.start()
    assert clock.wait_for_waiter()
    clock.advance(1.999)
    assert not ended
    clock.advance(0.001)
    waiting.join(10)
    assert ended == [True]
    assert clock.wait_until(0, cancelled)


def test_a_wait_can_be_cancelled() -> None:
    """False, without the time having come."""
    clock, cancelled = ManualClock(0), threading.Event()
    cancelled.set()
    assert not clock.wait_until(10, cancelled)
    assert not clock.wait_until(0, cancelled)


def test_wait_for_waiter_times_out() -> None:
    """In real time."""
    assert not ManualClock().wait_for_waiter(timeout_s=0.01)
