"""A feed in this process, without Ray."""

from streamkit_fleet.feed import Feed
from streamkit_fleet.feeds import FeedSpec
from tests.slowness import patience

VIDEO = "videotestsrc num-buffers=30 ! video/x-raw, width=32, height=32"


def test_a_feed_that_has_ended_keeps_its_counts() -> None:
    """Its metrics are no longer served, so that it names no address."""
    feed = Feed("gate", FeedSpec(text=f"{VIDEO} ! fakesink"), restarts=0, sharing=1)
    feed.join(patience(20))
    status = feed.status()
    assert (status.state, status.frames, status.metrics) == ("ended", 30, "")
