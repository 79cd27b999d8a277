"""A publisher knows who listens, from which number on, and says nothing more once it is closed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace

import zenoh

from streamkit_zenoh.publish.numbered_publisher import NumberedPublisher
from streamkit_zenoh.publish.qos import parse_qos
from streamkit_zenoh.wire.numbering import KEY_LIMIT

Opener = Callable[..., zenoh.Session]


def _publisher(session: zenoh.Session, key: str) -> NumberedPublisher:
    return NumberedPublisher(session, key, "tracks", 7, "application/json", parse_qos("block"), 5.0)


def test_a_listener_that_is_told_late_does_no_harm(open_test_session: Opener, key: str) -> None:
    """Zenoh may call it for a moment after the publisher has been taken back."""
    publisher = _publisher(open_test_session(), key)
    publisher.close()
    publisher._matching_changed(SimpleNamespace(matching=False))  # type: ignore[arg-type]
    publisher.refresh()
    assert not publisher.is_matching
    assert not publisher.has_subscriber


def test_a_receiver_is_told_what_it_is_sent(open_test_session: Opener, key: str) -> None:
    """From the number that came next when it was seen, however late it asks and however often it is seen."""
    publisher = _publisher(open_test_session(), key)
    numbers = []
    for name in ("early", "late", "early"):
        publisher.add_receiver(name)
        numbers.append(publisher.stamp().number)
    assert numbers == [0, 1, 2]
    told = {name: publisher.status(name).first_number for name in ("early", "late", "unknown")}
    assert told == {"early": 0, "late": 1, "unknown": None}
    assert publisher.status().first_number is None
    for index in range(KEY_LIMIT + 1):
        publisher.add_receiver(str(index))
    assert publisher.status("early").first_number is None


def test_closing_while_receivers_leave_says_nothing(
    open_test_session: Opener, key: str, endpoint: str
) -> None:
    """Whatever the order in which both sides end, no callback fails."""
    complaints: list[threading.ExceptHookArgs] = []
    session, other = open_test_session(listen=endpoint), open_test_session(connect=endpoint)
    hook, threading.excepthook = threading.excepthook, complaints.append
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
    assert not complaints
