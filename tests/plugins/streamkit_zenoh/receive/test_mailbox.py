"""The box is bounded in items and bytes, and nobody waits in it for ever."""

import threading

from streamkit_zenoh.receive.mailbox import Mailbox


def test_order_is_kept() -> None:
    """What goes in first comes out first."""
    box: Mailbox[int] = Mailbox(10, 1000, newest=False)
    for number in range(5):
        box.put(number, 1)
    assert [box.take(0) for _ in range(6)] == [0, 1, 2, 3, 4, None]


def test_newest_drops_the_oldest() -> None:
    """Full, the oldest go, and are counted."""
    box: Mailbox[int] = Mailbox(3, 1000, newest=True)
    for number in range(8):
        box.put(number, 1)
    assert [box.take(0) for _ in range(3)] == [5, 6, 7]
    assert box.dropped == 5


def test_bytes_are_bounded_too() -> None:
    """Few large items fill the box as many small ones do; one always fits."""
    box: Mailbox[int] = Mailbox(100, 1000, newest=True)
    for number in range(4):
        box.put(number, 400)
    assert box.dropped == 2
    box.put(9, 5000)
    assert [box.take(0), box.take(0)] == [9, None]


def test_a_full_box_holds_the_giver_up() -> None:
    """Lossless, the giver waits until something is taken."""
    box: Mailbox[int] = Mailbox(2, 1000, newest=False)
    given = threading.Semaphore(0)

    def give() -> None:
        for number in range(5):
            box.put(number, 1)
            given.release()

    giver = threading.Thread(target=give)
    giver.start()
    assert given.acquire(timeout=5)
    assert given.acquire(timeout=5)
    assert not given.acquire(timeout=0.05)
    assert [box.take(5) for _ in range(5)] == [0, 1, 2, 3, 4]
    giver.join(5)
    assert not giver.is_alive()
    assert box.dropped == 0


def test_close_wakes_the_giver() -> None:
    """A giver that waits is let go when the box closes: zenoh's thread must never hang."""
    box: Mailbox[int] = Mailbox(1, 1000, newest=False)
    box.put(0, 1)
    giver = threading.Thread(target=box.put, args=(1, 1))
    giver.start()
    box.close()
    giver.join(5)
    assert not giver.is_alive()
    assert box.is_over


def test_close_wakes_the_taker() -> None:
    """A taker that waits is let go at once."""
    box: Mailbox[int] = Mailbox(1, 1000, newest=False)
    taken: list[int | None] = []
    taker = threading.Thread(target=lambda: taken.append(box.take(60)))
    taker.start()
    box.close()
    taker.join(5)
    assert taken == [None]


def test_the_end_comes_behind_what_is_held() -> None:
    """An ended box is over when it is empty; a new publisher takes the end back."""
    box: Mailbox[int] = Mailbox(5, 1000, newest=False)
    box.put(1, 1)
    box.end()
    assert not box.is_over
    assert box.take(0) == 1
    assert box.is_over
    box.end(False)
    assert not box.is_over
