"""Replay: the history of a feed as a page gets it, as fast as it once came."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from streamkit_view.history import History
from streamkit_view.messages import PageMessage

LOOK_S = 0.1


async def replay(history: History, back_s: float, offer: Callable[[PageMessage], None]) -> None:
    """Offers what came `back_s` ago and later, each message at the same distance; ends only when cancelled.

    Args:
        history: of the feed.
        back_s: how far back to begin, s; from the keyframe before it.
        offer: takes a message.
    """
    number = history.start(time.monotonic() - back_s)
    delay_s: float | None = None
    while True:
        found = history.get(number)
        if found is None:
            await asyncio.sleep(LOOK_S)
            continue
        at, past = found
        now_s = time.monotonic()
        if delay_s is None:
            delay_s = now_s - past.at_s
        wait_s = past.at_s + delay_s - now_s
        if wait_s > 0:
            await asyncio.sleep(wait_s)
        number = at + 1
        offer(past.message)
