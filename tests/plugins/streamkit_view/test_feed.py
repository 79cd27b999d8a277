"""What a feed is said to do, by what its publisher publishes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import zenoh

from streamkit import Pipeline
from streamkit_view import feed as feed_module
from streamkit_view.feed import Feed
from streamkit_view.messages import PageMessage
from streamkit_view.playback import PrintedLine
from streamkit_zenoh.session import SessionSettings, close_session, open_session


@pytest.fixture
def received() -> list[PageMessage]:
    """What a feed has delivered."""
    return []


@pytest.fixture
def feed(session: zenoh.Session, key: str, received: list[PageMessage]) -> Iterator[Feed]:
    """A feed that receives."""
    found = Feed(session, key, 0, received.append)
    yield found
    for undeclare in found.close():
        undeclare()


@pytest.mark.parametrize("options", ["", "tracks=false", "tracks=false frame-rate=5", "track=false"])
def test_a_publisher_plays_whether_it_publishes_records_or_not(
    feed: Feed, key: str, wait_for: Callable[..., Any], options: str
) -> None:
    """Without records its status tells that frames come."""
    assert feed.state(0.0).state == "waiting"
    with Pipeline.parse(f"videotestsrc is-live=true ! zenohsink key={key} {options}") as pipeline:
        pipeline.play()
        wait_for(lambda: feed.state(0.0).state == "playing")
    wait_for(lambda: feed.state(0.0).state == "ended")


def test_a_publisher_without_frames_is_waited_for(
    feed: Feed, key: str, wait_for: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its status counts none; also where one before had frames, the last of which was long ago."""
    Pipeline.parse(f"videotestsrc num-buffers=5 ! zenohsink key={key} wait-subscribers=1").run(timeout_s=60)
    wait_for(lambda: feed.state(0.0).state == "ended")
    monkeypatch.setattr(feed_module, "SILENT_S", 0.0)
    text = f"appsrc name=in caps=video/x-raw,format=GRAY8,width=64,height=48 ! zenohsink key={key}"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        wait_for(lambda: feed.state(0.0).reason == "The publisher is there; no frame has come yet.")
        assert feed.state(0.0).state == "waiting"


@pytest.fixture
def other_session() -> Iterator[zenoh.Session]:
    """Of a page that is opened later."""
    session = open_session(SessionSettings())
    yield session
    close_session(session, 5.0)


@pytest.mark.parametrize("options", ["", "tracks=false"])
def test_a_publisher_that_stands_still_does_not_play(
    feed: Feed, other_session: zenoh.Session, key: str, wait_for: Callable[..., Any], options: str
) -> None:
    """To a page that is opened then: its last record and the frames that it has counted are of any age."""

    def has_taken_all(one: Feed) -> bool:
        state = one.state(0.0)
        has_status = state.status is not None and state.status.frames == 1
        return has_status and (bool(options) or state.received["tracks"] == 1)

    caps = "video/x-raw,format=GRAY8,width=64,height=48"
    with Pipeline.parse(f"appsrc name=in caps={caps} ! zenohsink key={key} {options}") as pipeline:
        pipeline.play()
        pipeline["in"].push(np.zeros((48, 64), np.uint8))
        wait_for(lambda: has_taken_all(feed))
        messages: list[PageMessage] = []
        late = Feed(other_session, key, 0, messages.append)
        wait_for(lambda: has_taken_all(late) and len(messages) == (not options))
        assert late.state(0.0).state == "waiting"
        for undeclare in late.close():
            undeclare()


def test_the_reason_of_a_silent_feed_is_what_its_pipeline_printed_since_the_last_frame(
    feed: Feed, key: str, wait_for: Callable[..., Any]
) -> None:
    """A camera that is away, and not the loops that were compiled before the first frame."""
    text = f"appsrc name=in caps=video/x-raw,format=GRAY8,width=64,height=48 ! zenohsink key={key}"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        wait_for(lambda: feed.state(0.0).state == "waiting")
        began_s = time.monotonic()
        pipeline["in"].push(np.zeros((48, 64), np.uint8))
        wait_for(lambda: feed.state(0.0).state == "silent")
        early, late = (
            PrintedLine("loops are compiled", began_s - 60),
            PrintedLine("refused; retrying", time.monotonic()),
        )
        assert feed.state(0.0, printed=early).reason.endswith("the pipeline stands still.")
        assert feed.state(0.0, printed=late).reason.endswith(" s: refused; retrying")
