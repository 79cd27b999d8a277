"""Publishers and receivers find each other by tokens, and every wait has a time limit."""

import threading
from collections.abc import Callable
from typing import NamedTuple, cast

import zenoh

from streamkit_zenoh.keys import LISTENING, alive_key
from streamkit_zenoh.presence import (
    LivelinessWatch,
    declare_receiver,
    wait_for_receivers,
    wait_until_delivered,
)

Opener = Callable[..., zenoh.Session]
NEVER = threading.Event()


def test_a_publishers_token_is_seen(open_test_session: Opener, endpoint: str, key: str) -> None:
    """An existing token is reported, and its end with the session's close."""
    publishing = open_test_session(listen=endpoint)
    token = publishing.liveliness().declare_token(alive_key(f"{key}/tracks"))
    counts: list[int] = []
    there, gone = threading.Event(), threading.Event()

    def changed(count: int) -> None:
        counts.append(count)
        (there if count else gone).set()

    watch = LivelinessWatch(open_test_session(connect=endpoint), alive_key(f"{key}/tracks"), changed)
    assert there.wait(10)
    assert token is not None
    publishing.close()
    assert gone.wait(10)
    assert counts == [1, 0]
    watch.close()


class Notification(NamedTuple):
    """What zenoh reports of a token."""

    key_expr: str
    kind: zenoh.SampleKind


def test_a_token_reported_after_its_end_is_queried(
    open_test_session: Opener, endpoint: str, key: str
) -> None:
    """Zenoh may report an old token after its end: it counts only if it is declared again."""
    publishing = open_test_session(listen=endpoint)
    token = publishing.liveliness().declare_token(alive_key(key))
    counts: list[int] = []
    changed_count = threading.Condition()

    def changed(count: int) -> None:
        with changed_count:
            counts.append(count)
            changed_count.notify_all()

    watching = open_test_session(connect=endpoint)
    watch = LivelinessWatch(watching, alive_key(key), changed)
    with changed_count:
        assert changed_count.wait_for(lambda: counts == [1], 10)
        token.undeclare()
        assert changed_count.wait_for(lambda: counts == [1, 0], 10)
    watch._take(cast("zenoh.Sample", Notification(alive_key(key), zenoh.SampleKind.PUT)))
    assert list(watching.liveliness().get(alive_key(key), timeout=10)) == []
    assert counts == [1, 0]
    again = publishing.liveliness().declare_token(alive_key(key))
    with changed_count:
        assert changed_count.wait_for(lambda: counts == [1, 0, 1], 10)
    watch.close()
    again.undeclare()


def test_receivers_are_counted(open_test_session: Opener, endpoint: str, key: str) -> None:
    """Two receivers of the key are enough for two, not for three; others do not count."""
    publishing = open_test_session(listen=endpoint)
    publisher, receivers = (
        publishing.declare_publisher(f"{key}/tracks"),
        LivelinessWatch(publishing, f"{LISTENING}/**"),
    )
    assert not wait_for_receivers(publisher, receivers, 1, 0.0, NEVER)
    held = []
    for expression in (f"{key}/tracks", "test/*/tracks", "elsewhere/tracks"):
        session = open_test_session(connect=endpoint)
        held += [session.declare_subscriber(expression), declare_receiver(session, expression)]
    assert wait_for_receivers(publisher, receivers, 2, 10.0, NEVER)
    assert not wait_for_receivers(publisher, receivers, 3, 0.1, NEVER)
    receivers.close()


def test_any_subscriber_is_one_receiver(open_test_session: Opener, endpoint: str, key: str) -> None:
    """A plain zenoh subscriber has no token, and counts for one receiver."""
    publishing = open_test_session(listen=endpoint)
    publisher, receivers = (
        publishing.declare_publisher(f"{key}/tracks"),
        LivelinessWatch(publishing, f"{LISTENING}/**"),
    )
    subscriber = open_test_session(connect=endpoint).declare_subscriber(f"{key}/**")
    assert wait_for_receivers(publisher, receivers, 1, 10.0, NEVER)
    subscriber.undeclare()
    receivers.close()


def test_a_cancelled_wait_ends(open_test_session: Opener, key: str) -> None:
    """A pipeline that stops does not wait for receivers."""
    session, cancelled = open_test_session(), threading.Event()
    cancelled.set()
    receivers = LivelinessWatch(session, f"{LISTENING}/**")
    assert not wait_for_receivers(session.declare_publisher(key), receivers, 1, 3600.0, cancelled)
    receivers.close()


def test_a_publisher_waits_until_all_is_delivered(open_test_session: Opener, endpoint: str, key: str) -> None:
    """A receiver replies after everything that was sent to it; without receivers there is no wait."""
    publishing = open_test_session(listen=endpoint)
    receivers = LivelinessWatch(publishing, f"{LISTENING}/**")
    records = f"{key}/tracks"
    assert wait_until_delivered(publishing, records, receivers, 10.0, NEVER)
    receiving, taken = open_test_session(connect=endpoint), []
    slow = threading.Event()

    def take(sample: zenoh.Sample) -> None:
        slow.wait(0.002)
        taken.append(sample)

    subscriber = receiving.declare_subscriber(records, zenoh.handlers.Callback(take, indirect=False))
    held = [
        subscriber,
        declare_receiver(receiving, records),
    ]
    publisher = publishing.declare_publisher(records, congestion_control=zenoh.CongestionControl.BLOCK)
    assert wait_for_receivers(publisher, receivers, 2, 0.0, NEVER) is False
    for _ in range(1000):
        if receivers.tokens():
            break
        slow.wait(0.01)
    for _ in range(200):
        publisher.put(bytes(1000))
    assert wait_until_delivered(publishing, records, receivers, 20.0, NEVER)
    assert len(taken) == 200
    assert held
    receivers.close()


def test_waiting_for_a_receiver_that_takes_nothing_is_bounded(
    open_test_session: Opener, endpoint: str, key: str
) -> None:
    """A stuck receiver costs the time limit, and nothing when the pipeline stops."""
    publishing = open_test_session(listen=endpoint)
    receivers, records, stuck = (
        LivelinessWatch(publishing, f"{LISTENING}/**"),
        f"{key}/tracks",
        threading.Event(),
    )
    receiving = open_test_session(connect=endpoint)
    subscriber = receiving.declare_subscriber(
        records, zenoh.handlers.Callback(lambda _: stuck.wait(20), indirect=False)
    )
    held = [
        subscriber,
        declare_receiver(receiving, records),
    ]
    publisher = publishing.declare_publisher(records)
    for _ in range(1000):
        if receivers.tokens() and publisher.matching_status.matching:
            break
        NEVER.wait(0.01)
    publisher.put(b"x")
    stopping = threading.Event()
    stopping.set()
    assert not wait_until_delivered(publishing, records, receivers, 3600.0, stopping)
    assert not wait_until_delivered(publishing, records, receivers, 0.2, NEVER)
    assert held
    stuck.set()
    receivers.close()
