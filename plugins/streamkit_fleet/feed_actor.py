"""FeedActor: the feeds of a process that Ray places and restarts."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping

import ray
from msgspec.structs import replace

from streamkit_fleet.feed import STOP_LIMIT_S, Feed, FeedStatus
from streamkit_fleet.feeds import FeedProcess


class FeedActor:
    """The feeds of a process: mostly one, or those that share it."""

    def __init__(self, process: FeedProcess) -> None:
        context = ray.get_runtime_context()
        restarts = int(context.was_current_actor_reconstructed)
        self._place = {"process": process.name, "node": context.get_node_id(), "pid": os.getpid()}
        os.nice(process.nice)  # of this thread and of those that it starts, not of Ray's
        self._feeds = {
            name: Feed(name, feed, restarts=restarts, sharing=len(process.feeds))
            for name, feed in process.feeds.items()
        }

    def statuses(self) -> list[FeedStatus]:
        """State and counters of each feed."""
        return [replace(feed.status(), **self._place) for feed in self._feeds.values()]

    def logs(self, name: str) -> list[str]:
        """The newest lines of a feed."""
        return self._feeds[name].logs()

    def stop(self) -> None:
        """Ends the streams, so that files are completed, and waits for it."""
        deadline_s = time.monotonic() + STOP_LIMIT_S
        for feed in self._feeds.values():
            feed.stop()
        for feed in self._feeds.values():
            feed.join(max(0.0, deadline_s - time.monotonic()))

    def refuse(self, reasons: Mapping[str, str]) -> None:
        """Ends the streams of feeds for want of room, with the reason of each."""
        for name in reasons.keys() & self._feeds.keys():
            self._feeds[name].refuse(reasons[name])
