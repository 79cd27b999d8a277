"""Viewer: the messages that wait for one page, bounded, and how far the page is behind."""

from __future__ import annotations

import json
import time
from collections import Counter, deque
from collections.abc import Callable

from streamkit_view.history import Past
from streamkit_view.messages import BACK, CONTROL, SKIPPED, TRACKS, VIDEO, InvalidAnswer, PageMessage

# What may be under way to a page that has not confirmed it, and what may wait for that.
WINDOW_MESSAGES, WINDOW_BYTES = 100, 3 << 20
WAITING_MESSAGES, WAITING_BYTES = 600, 12 << 20
LATE_S = 2.0  # as long as the page calls a feed silent
ANSWER_LIMIT_S = 10.0


class Viewer:
    """One page: what waits to be sent to it. Belongs to one thread.

    A page confirms what it has taken. While too much is unconfirmed, messages wait. When too many wait, or a
    keyframe comes while some have waited too long, video is skipped up to the newest keyframe, and of
    everything else only the newest is kept.

    Attributes:
        feed: index of the feed that it shows.
        is_live: whether it shows what comes, and not the past.
    """

    def __init__(self) -> None:
        self.feed = 0
        self.is_live = True
        self._waiting: deque[Past] = deque()
        self._under_way: deque[int] = deque()
        self._bytes = self._bytes_under_way = self._confirmed = 0
        self._skipped: Counter[int] = Counter()
        self._needs_keyframe: set[int] = set()
        self._last_answer_s = time.monotonic()

    def offer(self, message: PageMessage) -> None:
        """Queues a message; may skip others, or this one."""
        if message.kind == VIDEO:
            if message.is_keyframe:
                self._needs_keyframe.discard(message.feed)
                self._report_skipped(message.feed, time.monotonic())
            elif message.feed in self._needs_keyframe:
                self._skipped[message.feed] += 1
                return
        elif message.kind not in (TRACKS, CONTROL, BACK):
            self._remove(lambda held: held.is_void_after(message))
        now_s = time.monotonic()
        is_late = bool(self._waiting) and now_s - self._waiting[0].at_s > LATE_S
        self._append(Past(now_s, message))
        if self._is_full() or (message.is_keyframe and is_late):
            self._thin_out()

    def select(self, feed: int, *, is_live: bool = True) -> None:
        """Shows another feed, or its past; what waits of the one before is not sent."""
        self._remove(lambda held: held.feed == self.feed)
        self._skipped.pop(self.feed, None)
        self._needs_keyframe.discard(self.feed)
        self.feed, self.is_live = feed, is_live

    def next(self) -> PageMessage | None:
        """The message to send now; None while nothing waits or the page must catch up."""
        if not self._waiting or len(self._under_way) >= WINDOW_MESSAGES:
            return None
        size = len(self._waiting[0].message.data)
        if self._under_way and self._bytes_under_way + size > WINDOW_BYTES:
            return None
        if not self._under_way:
            self._last_answer_s = time.monotonic()
        message = self._waiting.popleft().message
        self._bytes -= size
        self._bytes_under_way += size
        self._under_way.append(size)
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
            self._bytes_under_way -= self._under_way.popleft()
        self._confirmed = count
        self._last_answer_s = time.monotonic()

    @property
    def is_stuck(self) -> bool:
        """Whether the page has confirmed nothing for ten seconds, though something is under way to it."""
        return bool(self._under_way) and time.monotonic() - self._last_answer_s > ANSWER_LIMIT_S

    def _append(self, past: Past) -> None:
        self._waiting.append(past)
        self._bytes += len(past.message.data)

    def _is_full(self) -> bool:
        return len(self._waiting) > WAITING_MESSAGES or (
            self._bytes > WAITING_BYTES and len(self._waiting) > 1
        )

    def _report_skipped(self, feed: int, at_s: float) -> None:
        if count := self._skipped.pop(feed, 0):
            body = json.dumps({"type": SKIPPED, "feed": feed, "body": {"frames": count}})
            self._append(Past(at_s, PageMessage(SKIPPED, feed, body)))

    def _thin_out(self) -> None:
        """Keeps video from the newest keyframe on, or none, and the newest message of each other kind."""
        held = list(self._waiting)
        newest = {message.identity: message for _, message in held}
        keyframes = {message.feed: at for at, (_, message) in enumerate(held) if message.is_keyframe}
        is_short = bool(keyframes) and max(keyframes.values()) > len(held) // 2
        self._waiting.clear()
        self._bytes = 0
        for at, past in enumerate(held):
            message = past.message
            if message.kind == SKIPPED:
                self._skipped[message.feed] += json.loads(message.data)["body"]["frames"]
            elif message.kind == VIDEO:
                if is_short and at >= keyframes.get(message.feed, len(held)):
                    if message.is_keyframe:
                        self._report_skipped(message.feed, past.at_s)
                    self._append(past)
                else:
                    self._skipped[message.feed] += 1
                    if not is_short:
                        self._needs_keyframe.add(message.feed)
            elif newest[message.identity] is message:
                self._append(past)

    def _remove(self, is_chosen: Callable[[PageMessage], bool]) -> None:
        kept = [past for past in self._waiting if not is_chosen(past.message)]
        self._bytes = sum(len(past.message.data) for past in kept)
        self._waiting = deque(kept)
