"""Wakeup: a sign for one sleeper."""

import threading

from streamkit.elements.wakeup import Wakeup


def test_a_sign_left_before_the_sleep_is_found_once() -> None:
    """Whoever sets it first is not missed; two signs are one, and taking it clears it."""
    wakeup = Wakeup()
    wakeup.set()
    wakeup.set()
    assert wakeup.wait(10)
    assert not wakeup.wait(0.0)


def test_a_sleeper_is_woken_by_another_thread() -> None:
    """Handed to and fro a thousand times, no sign is lost."""
    ping, pong = Wakeup(), Wakeup()
    answered = []

    def answer() -> None:
        for _ in range(1000):
            if not ping.wait(10):
                return
            answered.append(True)
            pong.set()

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        for _ in range(1000):
            ping.set()
            assert pong.wait(10)
    finally:
        thread.join(20)
    assert len(answered) == 1000
