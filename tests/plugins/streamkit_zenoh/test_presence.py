"""Publishers and receivers know of each other by tokens, and nobody is waited for without bounds."""

import threading
from collections.abc import Callable

import zenoh

from streamkit_zenoh.keys import alive_key
from streamkit_zenoh.presence import Watch, show_publisher, show_receiver, wait_for_receivers, watch_receivers

Opener = Callable[..., zenoh.Session]
NEVER = threading.Event()


def test_a_publishers_life_is_seen(open_test_session: Opener, endpoint: str, key: str) -> None:
    """A token that was there before is seen, and so is its end with the session's close."""
    publishing = open_test_session(listen=(endpoint,))
    token = show_publisher(publishing, f"{key}/tracks")
    counts: list[int] = []
    there, gone = threading.Event(), threading.Event()

    def changed(count: int) -> None:
        counts.append(count)
        (there if count else gone).set()

    watch = Watch(open_test_session(connect=(endpoint,)), alive_key(f"{key}/tracks"), changed)
    assert there.wait(10)
    assert token is not None
    publishing.close()
    assert gone.wait(10)
    assert counts == [1, 0]
    watch.close()


def test_receivers_are_counted(open_test_session: Opener, endpoint: str, key: str) -> None:
    """Two that receive the key are enough for two, and not for three; others do not count."""
    publishing = open_test_session(listen=(endpoint,))
    publisher, receivers = publishing.declare_publisher(f"{key}/tracks"), watch_receivers(publishing)
    assert not wait_for_receivers(publisher, receivers, 1, 0.0, NEVER)
    held = []
    for expression in (f"{key}/tracks", "test/*/tracks", "elsewhere/tracks"):
        session = open_test_session(connect=(endpoint,))
        held += [session.declare_subscriber(expression), show_receiver(session, expression)]
    assert wait_for_receivers(publisher, receivers, 2, 10.0, NEVER)
    assert not wait_for_receivers(publisher, receivers, 3, 0.1, NEVER)
    receivers.close()


def test_any_subscriber_is_one_receiver(open_test_session: Opener, endpoint: str, key: str) -> None:
    """A subscriber of another make shows no token, and is served all the same."""
    publishing = open_test_session(listen=(endpoint,))
    publisher, receivers = publishing.declare_publisher(f"{key}/tracks"), watch_receivers(publishing)
    subscriber = open_test_session(connect=(endpoint,)).declare_subscriber(f"{key}/**")
    assert wait_for_receivers(publisher, receivers, 1, 10.0, NEVER)
    subscriber.undeclare()
    receivers.close()


def test_a_cancelled_wait_ends(open_test_session: Opener, key: str) -> None:
    """A pipeline that stops does not wait for receivers."""
    session, cancelled = open_test_session(), threading.Event()
    cancelled.set()
    receivers = watch_receivers(session)
    assert not wait_for_receivers(session.declare_publisher(key), receivers, 1, 3600.0, cancelled)
    receivers.close()
