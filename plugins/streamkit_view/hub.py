"""Hub: brings the messages of feeds to the pages that show them; runs in the server's event loop."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from streamkit_view.history import HISTORY_BYTES, History
from streamkit_view.messages import FRAME, MOSAIC, TILE, TRACKS, VIDEO, PageMessage
from streamkit_view.viewer import Viewer

PAST = (VIDEO, TRACKS, FRAME)
SHOWN = (*PAST, MOSAIC, TILE)


class Hub:
    """The pages and what they are sent. All but `deliver` belongs to the event loop's thread.

    Args:
        feeds: how many feeds there are.
        first_appeared: called when a page comes and there is no other.

    Attributes:
        history: the last minutes of each feed.
    """

    def __init__(self, feeds: int, first_appeared: Callable[[], None]) -> None:
        self.history = [History(HISTORY_BYTES // max(1, feeds)) for _ in range(feeds)]
        self._pages: set[Viewer] = set()
        self._first_appeared = first_appeared
        self._loop: asyncio.AbstractEventLoop | None = None

    def attach_loop(self) -> None:
        """Notes the running event loop, to which `deliver` hands messages."""
        self._loop = asyncio.get_running_loop()

    def deliver(self, message: PageMessage) -> None:
        """Sends a message to the pages; may be called from any thread."""
        loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self.publish, message)

    def publish(self, message: PageMessage) -> None:
        """Queues a message for the pages of its feed; the states of all feeds go to all pages."""
        if message.kind in SHOWN:
            self.history[message.feed].note(message, time.monotonic())
        for viewer in self._pages:
            is_shown = viewer.feed == message.feed and (viewer.is_live or message.kind not in PAST)
            if is_shown or message.kind not in SHOWN:
                viewer.offer(message)

    def add(self, viewer: Viewer) -> None:
        """Adds a page."""
        if not self._pages:
            self._first_appeared()
        self._pages.add(viewer)
        self.greet(viewer)

    def remove(self, viewer: Viewer) -> None:
        """The page is gone."""
        self._pages.remove(viewer)

    def select(self, viewer: Viewer, feed: int) -> None:
        """A page shows another feed, or the same one live again."""
        if viewer.feed != feed or not viewer.is_live:
            viewer.select(feed)
            self.greet(viewer)

    @property
    def pages(self) -> int:
        """How many pages there are."""
        return len(self._pages)

    def greet(self, viewer: Viewer) -> None:
        """Sends a page what a new one begins with."""
        for message in self.history[viewer.feed].latest():
            viewer.offer(message)
