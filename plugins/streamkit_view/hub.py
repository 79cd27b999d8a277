"""Hub: brings the messages of feeds to the pages that show them; runs in the server's event loop."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable

import msgspec

from streamkit_view.history import HISTORY_BYTES, History, Past
from streamkit_view.messages import (
    BACK,
    CONTROL,
    FRAME,
    HELLO,
    MOSAIC,
    SKIPPED,
    TILE,
    TRACKS,
    VIDEO,
    Identity,
    InvalidAnswer,
    PageMessage,
    text_message,
)

# What may be under way to a page that has not confirmed it, and what may wait for that.
WINDOW_MESSAGES, WINDOW_BYTES = 100, 3 << 20
WAITING_MESSAGES, WAITING_BYTES = 600, 12 << 20
WAITING_REPLIES = 16  # no page asks for more before it reads one; of others the oldest are lost
LATE_S = 2.0  # as long as the page calls a feed silent
ANSWER_LIMIT_S = 10.0
PAST = (VIDEO, TRACKS, FRAME)
SHOWN = (*PAST, MOSAIC, TILE)


class Viewer:
    """One page: what waits to be sent to it. Belongs to one thread.

    A page confirms what it has taken. While too much is unconfirmed, messages wait in three lanes: replies,
    which are sent first; packets and records, of which a late page skips some; and everything else,
    of which the newest of each identity waits. Packets and records are skipped up to the newest keyframe when
    too many wait, or when a keyframe comes while one has waited too long.

    Attributes:
        feed: index of the feed that it shows.
        is_live: whether it shows what comes, and not the past.
        shows_stills: whether it is sent images, which a page with video does not show.
        changed: set when there may be something to send.
    """

    def __init__(self) -> None:
        self.feed = 0
        self.is_live = True
        self.shows_stills = True
        self.changed = asyncio.Event()
        self._replies: deque[PageMessage] = deque(maxlen=WAITING_REPLIES)
        self._stream: deque[Past] = deque()
        self._stream_bytes = 0
        self._newest: dict[Identity, Past] = {}
        self._skipped = 0
        self._needs_keyframe = False
        self._under_way: deque[int] = deque()  # bytes of each message
        self._confirmed = 0
        self._last_answer_s = time.monotonic()

    def offer(self, message: PageMessage) -> None:
        """Queues a message; may skip others, or this one."""
        if message.kind in (HELLO, BACK, CONTROL):
            self._replies.append(message)
        elif message.kind in (VIDEO, TRACKS):
            self._offer_to_stream(Past(time.monotonic(), message))
        elif message.kind != FRAME or self.shows_stills:
            kept = {
                key: past for key, past in self._newest.items() if not past.message.is_void_after(message)
            }
            self._newest = {**kept, message.identity: Past(time.monotonic(), message)}
        self.changed.set()

    def select(self, feed: int, *, is_live: bool = True) -> None:
        """Shows another feed, or its past; what waits of the one before is not sent."""
        self._newest = {}
        self._keep([])
        self._skipped, self._needs_keyframe = 0, False
        self.feed, self.is_live, self.shows_stills = feed, is_live, True

    def next(self) -> PageMessage | None:
        """The message to send now; None while nothing waits or the page must catch up."""
        if len(self._under_way) >= WINDOW_MESSAGES or sum(self._under_way) >= WINDOW_BYTES:
            return None
        message = self._take()
        if message is not None:
            if not self._under_way:
                self._last_answer_s = time.monotonic()
            self._under_way.append(len(message.data))
        return message

    def confirm(self, count: int) -> None:
        """Notes that the page has taken so many messages in all.

        Raises:
            InvalidAnswer: it was not sent so many, or had confirmed more.
        """
        new = count - self._confirmed
        if not 0 <= new <= len(self._under_way):
            raise InvalidAnswer("it confirms messages that it was not sent")
        for _ in range(new):
            self._under_way.popleft()
        self._confirmed = count
        self._last_answer_s = time.monotonic()
        self.changed.set()

    @property
    def is_stuck(self) -> bool:
        """Whether the page has confirmed nothing for ten seconds, though something is under way to it."""
        return bool(self._under_way) and time.monotonic() - self._last_answer_s > ANSWER_LIMIT_S

    def _offer_to_stream(self, past: Past) -> None:
        message, stream = past.message, self._stream
        if message.kind == VIDEO and self._needs_keyframe and not message.is_keyframe:
            self._skipped += 1
            return
        if message.is_keyframe:
            self._needs_keyframe = False
        is_late = bool(stream) and past.at_s - stream[0].at_s > LATE_S
        stream.append(past)
        self._stream_bytes += len(message.data)
        is_full = len(stream) > WAITING_MESSAGES or (self._stream_bytes > WAITING_BYTES and len(stream) > 1)
        if is_full or (message.is_keyframe and is_late):
            self._skip()

    def _skip(self) -> None:
        """Skips what waits before the newest keyframe; where that is little, all but the newest record."""
        held = list(self._stream)
        begin = max((at for at, past in enumerate(held) if past.message.is_keyframe), default=0)
        if begin <= len(held) // 2:
            begin, self._needs_keyframe = len(held), True
        self._skipped += sum(past.message.kind == VIDEO for past in held[:begin])
        self._keep(held[begin:] or [past for past in held if past.message.kind == TRACKS][-1:])

    def _keep(self, held: list[Past]) -> None:
        self._stream = deque(held)
        self._stream_bytes = sum(len(past.message.data) for past in held)

    def _take(self) -> PageMessage | None:
        """A reply; how many frames were skipped; or else what has waited longest."""
        if self._replies:
            return self._replies.popleft()
        if self._skipped:
            body = msgspec.json.encode({"frames": self._skipped})
            self._skipped = 0
            return text_message(SKIPPED, self.feed, body)
        newest = next(iter(self._newest.values()), None)
        if newest is not None and not (self._stream and self._stream[0].at_s <= newest.at_s):
            return self._newest.pop(newest.message.identity).message
        if not self._stream:
            return None
        message = self._stream.popleft().message
        self._stream_bytes -= len(message.data)
        return message


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
