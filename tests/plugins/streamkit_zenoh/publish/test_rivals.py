"""Two publishers at one key are found at the start: refused, taken over, or shared."""

import itertools
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
import zenoh

from streamkit import ElementFailure, Frame, StreamkitError, Tracks, raw_video_caps
from streamkit.testing import Harness
from streamkit_zenoh.presence import Claimant, KeyInUse, LivelinessWatch, RivalWatch, refuse_rivals
from streamkit_zenoh.subscriber import TrackSubscriber
from tests.slowness import patience

Opener = Callable[..., zenoh.Session]


def frame(seq: int) -> Frame:
    """A frame without targets."""
    caps = raw_video_caps("GRAY8", 4, 2)
    return Frame(np.zeros((2, 4), np.uint8), caps, pts=seq * 40, seq=seq, arrival_ns=1).attach(Tracks())


def publish_until_refused(key: str) -> None:
    """Publishes in the place of another; on a busy machine the other is only seen after the start."""
    with Harness("zenohsink", key=key) as second:
        deadline_s = time.monotonic() + patience(20)
        for seq in itertools.takewhile(lambda _: time.monotonic() < deadline_s, itertools.count()):
            second.push(frame(seq))
            time.sleep(0.001)


def test_a_second_publisher_is_refused(key: str) -> None:
    """The error has the run, host and start of the first, which goes on; afterwards the key is free."""
    with Harness("zenohsink", key=key) as first:
        rule = rf"key={key}: another publisher .*: run \d+ on .+ \(process \d+\), started 20.* UTC"
        with pytest.raises(StreamkitError, match=rule):
            publish_until_refused(key)
        first.push(frame(0))
    with Harness("zenohsink", key=key) as next_one:
        next_one.push(frame(0))


def test_a_takeover_ends_the_first(key: str) -> None:
    """It fails at its next frame, with the name of the other."""
    with Harness("zenohsink", key=key) as first:
        first.push(frame(0))
        with Harness("zenohsink", key=key, takeover=True) as second:
            publication = first.element._publication
            while publication.records._fault is None:
                time.sleep(0.001)
            with pytest.raises(ElementFailure, match=f"key={key}: taken over by run"):
                first.push(frame(1))
            second.push(frame(0))


def test_shared_publishers_are_kept_apart(key: str) -> None:
    """Subscribers get all, with their runs, and are warned; the run that began last is the current one."""
    with (
        TrackSubscriber(key, ring=100, ask_last=False) as subscriber,
        Harness("zenohsink", key=key, shared=True, wait_subscribers=1) as first,
    ):
        first.push(frame(0))
        assert subscriber.get(10) is not None
        with Harness("zenohsink", key=key, shared=True, wait_subscribers=1) as second:
            runs = []
            for seq in range(1, 11):
                for publisher in (second, first):
                    publisher.push(frame(seq))
                    update = subscriber.update(10)
                    assert update is not None
                    runs.append(update.run)
        counts = subscriber.counts
        assert len(set(runs)) == 2
        assert runs == runs[:2] * 10
        assert (counts.received, counts.lost, counts.restarts, counts.interleaved) == (21, 0, 1, 8)
        assert any("two publishers use one key" in text for text in subscriber.warnings())


def test_who_a_publisher_is(open_test_session: Opener, key: str) -> None:
    """A token says it; other tokens are ignored."""
    publisher = Claimant("exclusive", 1_763_690_000_000_000_000, "a host/of mine", 17)
    assert Claimant.of(publisher.token(key)) == publisher
    assert str(publisher).endswith("on a host/of mine (process 17), started 2025-11-21 01:53:20 UTC")
    assert Claimant.of(f"{key}/publisher/x") is None
    session = open_test_session()
    token = session.liveliness().declare_token(f"{key}/publisher/x")
    refuse_rivals(open_test_session(), key, threading.Event())
    token.undeclare()


def test_a_publisher_that_is_seen_at_the_start_is_refused_with_a_remedy(
    open_test_session: Opener, key: str
) -> None:
    """It is waited for, as one that was killed is missed after a while."""
    here, there = open_test_session(), open_test_session()
    other = Claimant("exclusive", 1_763_690_000_000_000_000, "host", 17)
    seen = threading.Event()
    watch = LivelinessWatch(here, f"{key}/**", appeared=lambda _token: seen.set())
    token = there.liveliness().declare_token(other.token(key))
    assert seen.wait(patience(20))
    with pytest.raises(
        KeyInUse, match=rf"key={key}: another publisher is there: run \d+ .*; .*takeover=true"
    ):
        refuse_rivals(here, key, threading.Event())
    token.undeclare()
    watch.close()


@pytest.mark.parametrize(("claim", "ends"), [("exclusive", True), ("shared", False)])
def test_of_two_that_meet_later_the_later_one_ends(
    open_test_session: Opener, key: str, claim: str, ends: bool
) -> None:
    """As after a network was cut; the earlier one stays."""
    found: dict[str, KeyInUse] = {}
    seen = threading.Event()
    sessions = open_test_session(), open_test_session()
    for name, session, run in (("later", sessions[0], 2), ("earlier", sessions[1], 1)):

        def note(reason: KeyInUse, name: str = name) -> None:
            found[name] = reason
            seen.set()

        RivalWatch(session, key, Claimant(claim, run, "host", 1), note)
    assert seen.wait(10 if ends else 0.3) is ends
    assert list(found) == (["later"] if ends else [])
