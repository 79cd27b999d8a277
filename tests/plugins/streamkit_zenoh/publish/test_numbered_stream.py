"""A publisher knows its receivers and their first numbers, also while they leave and it closes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import zenoh

from streamkit import Caps, Frame
from streamkit_zenoh.publish.numbered_stream import NumberedStream, Outgoing, Publisher, Sender
from streamkit_zenoh.publish.settings import PublicationSettings
from streamkit_zenoh.wire.numbering import KEY_LIMIT

Opener = Callable[..., zenoh.Session]


def _owner(session: zenoh.Session, key: str) -> Publisher:
    return Publisher(
        session, key, PublicationSettings(), time.time_ns, 7, print, lambda *_: None, threading.Event()
    )


def _publisher(session: zenoh.Session, key: str) -> NumberedStream:
    return NumberedStream(_owner(session, key), "tracks", "application/json")


def test_after_its_close_a_stream_has_no_subscriber(open_test_session: Opener, key: str) -> None:
    """Nor when the session is closed first."""
    session = open_test_session()
    closed, left = _publisher(session, key), _publisher(session, key)
    closed.close()
    assert not closed.has_subscriber
    session.close()
    assert not left.has_subscriber


def test_a_receiver_has_a_first_number(open_test_session: Opener, key: str) -> None:
    """The next number when its token was first seen, however late it asks."""
    publisher = Sender(_owner(open_test_session(), key), "tracks", "application/json", capacity=4)
    numbers = []
    for name in ("early", "late", "early"):
        publisher.add_receiver(name)
        numbers.append(publisher.take_stamp().number)
    assert numbers == [0, 1, 2]
    first_numbers = {name: publisher.status(name).first_number for name in ("early", "late", "unknown")}
    assert first_numbers == {"early": 0, "late": 1, "unknown": None}
    assert publisher.status().first_number is None
    for index in range(KEY_LIMIT + 1):
        publisher.add_receiver(str(index))
    assert publisher.status("early").first_number is None
    assert publisher.executor.close(5)


def test_a_message_that_is_sent_late_is_not_the_last(open_test_session: Opener, key: str) -> None:
    """A frame without a subscriber is settled at once, while one before it may still be sent."""
    sender = Sender(_owner(open_test_session(), key), "tracks", "application/json", capacity=4)
    late, newest = (Outgoing(Frame(b"", Caps("x/y")), sender.take_stamp(), 0) for _ in range(2))
    assert sender.status().settled_number == 0
    sender.settle(newest)
    sender.settle(late)
    assert sender.last is newest
    assert sender.status().settled_number == 2
    assert sender.executor.close(5)


def test_closing_while_receivers_leave_raises_nothing(
    open_test_session: Opener, key: str, endpoint: str
) -> None:
    """Whatever the order in which both sides end, no callback fails."""
    failures: list[threading.ExceptHookArgs] = []
    session, other = open_test_session(listen=endpoint), open_test_session(connect=endpoint)
    hook, threading.excepthook = threading.excepthook, failures.append
    try:
        for number in range(20):
            publisher = _publisher(session, f"{key}/{number}")
            subscriber = other.declare_subscriber(f"{key}/{number}/tracks", zenoh.handlers.RingChannel(1))
            leaving = threading.Thread(target=subscriber.undeclare)
            leaving.start()
            publisher.close()
            leaving.join(10)
    finally:
        threading.excepthook = hook
    assert not failures
