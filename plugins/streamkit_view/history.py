"""History: the last minutes of a feed, bounded, for pages that go back in time."""

from __future__ import annotations

import asyncio
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from itertools import islice
from typing import NamedTuple

from streamkit_view.messages import FRAME, MOSAIC, TILE, TRACKS, VIDEO, Identity, PageMessage

POLL_S = 0.1
HISTORY_S = 300.0
LATEST = (FRAME, TRACKS, MOSAIC, TILE)
HISTORY_BYTES = 128 << 20  # four minutes at 4 Mbit/s


# Video since the newest keyframe, which a new page begins with; of more, it waits for the next one.
GROUP_MESSAGES, GROUP_BYTES = 400, 8 << 20


class Past(NamedTuple):
    """A message and when it came, monotonic s."""

    at_s: float
    message: PageMessage


class History:
    """The messages of one feed, whose data is bounded: the oldest are dropped."""

    def __init__(self, max_bytes: int = HISTORY_BYTES) -> None:
        self._max_bytes = max_bytes
        self._held: deque[Past] = deque()
        self._bytes = 0
        self._first = 0  # number of the oldest message held
        self._last: dict[Identity, PageMessage] = {}  # but video

    def note(self, message: PageMessage, now_s: float) -> None:
        """Keeps a message; of the mosaic only the newest of each tile."""
        if message.kind != VIDEO:
            if message.kind == MOSAIC:
                self._last = {
                    key: last for key, last in self._last.items() if not last.is_void_after(message)
                }
            self._last[message.identity] = message
        if message.kind in (MOSAIC, TILE):
            return
        self._held.append(Past(now_s, message))
        self._bytes += len(message.data)
        while self._held and (self._bytes > self._max_bytes or now_s - self._held[0].at_s > HISTORY_S):
            self._bytes -= len(self._held.popleft().message.data)
            self._first += 1

    def span_s(self, now_s: float) -> float:
        """How far back one can go, s."""
        return now_s - self._held[0].at_s if self._held else 0.0

    def start(self, at_s: float) -> int:
        """Number of the message to begin with: the last keyframe at a time, else the next message."""
        count = bisect_right(self._held, at_s, key=lambda past: past.at_s)
        for number, past in enumerate(reversed(list(islice(self._held, count))), 1):
            if past.message.is_keyframe:
                return self._first + count - number
        return self._first + min(count, max(0, len(self._held) - 1))

    def latest(self) -> list[PageMessage]:
        """What a new page is sent first: image, video since the newest keyframe, record, mosaic."""
        group: deque[PageMessage] = deque()
        for message in (past.message for past in reversed(self._held) if past.message.kind == VIDEO):
            group.appendleft(message)
            if message.is_keyframe or len(group) > GROUP_MESSAGES:
                break
        is_shown = bool(group) and group[0].is_keyframe and sum(len(one.data) for one in group) <= GROUP_BYTES
        last = {kind: [message for message in self._last.values() if message.kind == kind] for kind in LATEST}
        return [*last[FRAME], *(group if is_shown else ()), *last[TRACKS], *last[MOSAIC], *last[TILE]]

    def get(self, number: int) -> tuple[int, Past] | None:
        """The message of a number, or the oldest one after it, with its number; None if there is none yet."""
        at = max(0, number - self._first)
        return (self._first + at, self._held[at]) if at < len(self._held) else None


async def replay(history: History, back_s: float, offer: Callable[[PageMessage], None]) -> None:
    """Offers what came `back_s` ago and later, from the keyframe before it, each message at its distance.

    Ends only when cancelled.
    """
    number = history.start(time.monotonic() - back_s)
    delay_s: float | None = None
    while True:
        found = history.get(number)
        if found is None:
            await asyncio.sleep(POLL_S)
            continue
        at, past = found
        now_s = time.monotonic()
        if delay_s is None:
            delay_s = now_s - past.at_s
        if (wait_s := past.at_s + delay_s - now_s) > 0:
            await asyncio.sleep(wait_s)
        number = at + 1
        offer(past.message)
