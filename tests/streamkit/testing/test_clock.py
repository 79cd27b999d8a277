"""The clock that tests move by hand."""

import threading

from streamkit.testing import ManualClock


def test_it_moves_only_by_hand() -> None:
    """Both readings stand still until `advance`."""
    clock = ManualClock(5)
    assert (clock.monotonic_ns(), clock.utc_ns()) == (5, 5)
    clock.advance(1.5)
    assert (clock.monotonic_ns(), clock.utc_ns()) == (1_500_000_005, 1_500_000_005)


def test_a_wait_ends_when_its_time_has_come() -> None:
    """Not before, and at once where it has passed."""
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


def test_missing_subscribers_are_reported_in_time() -> None:
    """The look for a waiter is bounded in real time."""
    assert not ManualClock().wait_for_waiter(timeout_s=0.01)
