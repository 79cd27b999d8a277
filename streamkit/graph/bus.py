"""Bus: messages from all threads of a graph to the application."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Sequence

from streamkit.flow.messages import Message, MessageKind
from streamkit.handoff.bounded_queue import BoundedQueue

log = logging.getLogger("streamkit")

CAPACITY = 4096


class Bus:
    """A bounded queue of messages; if full, it drops the oldest, errors and eos last.

    Attributes:
        counts: of the messages since the last `flush`, by source and kind.
    """

    def __init__(self) -> None:
        self._unread_error: Message | None = None  # as long as none was read, and there is no watcher
        self.counts: Counter[tuple[str, MessageKind]] = Counter()
        self._queue = BoundedQueue[Message](CAPACITY, choose_dropped=_choose_dropped)
        self._watchers: list[Callable[[Message], None]] = []
        self._faulty: list[Callable[[Message], None]] = []

    @property
    def lost(self) -> int:
        """Number of dropped messages."""
        return self._queue.dropped

    def post(self, message: Message) -> None:
        """Queues a message; watchers are called with it in the posting thread."""
        self.counts[message.source, message.kind] += 1
        for watcher in tuple(self._watchers):
            try:
                watcher(message)
            except Exception:  # the element or thread that posts has no part in it
                self._log_once(watcher, message)
        if message.kind is MessageKind.ERROR and not self._watchers:
            self._unread_error = self._unread_error or message
        self._queue.put(message)

    def _log_once(self, watcher: Callable[[Message], None], message: Message) -> None:
        if watcher not in self._faulty:
            self._faulty.append(watcher)
            text = "a function given to bus.watch has raised, at the message %s of %s; the pipeline goes on"
            log.exception(text, message.kind, message.source or "the pipeline")

    def log_unread_error(self) -> None:
        """Logs the first error that the program has not read, so that a script without `wait` hears of it."""
        error, self._unread_error = self._unread_error, None
        if error is not None:
            log.error("%s", error.text)

    def flush(self) -> None:
        """Discards unread messages and resets the counters."""
        self.counts.clear()
        while self._queue.get() is not None:
            continue
        self._unread_error = None

    def watch(self, watcher: Callable[[Message], None]) -> None:
        """Calls a function with every message, in the thread that posts it; the first exception is logged."""
        self._watchers.append(watcher)

    def pop(self, timeout_s: float | None = 0.0, kinds: tuple[MessageKind, ...] = ()) -> Message | None:
        """The next message, of one of `kinds` if any are given; None at the timeout.

        A wait for some kinds ends with None, too, when the pipeline is stopped.

        Args:
            timeout_s: maximum wait; None has no limit, but Ctrl-C ends it.
            kinds: other messages are discarded while waiting.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            message = self._queue.get(None if deadline is None else max(0.0, deadline - time.monotonic()))
            if message is not None and message.kind is MessageKind.ERROR:
                self._unread_error = None
            if message is None or not kinds or message.kind in kinds:
                return message
            if message.kind is MessageKind.STATE and message.text == "null":
                return None


def _choose_dropped(messages: Sequence[Message], _: Message, is_full: bool) -> range:
    kept = (MessageKind.ERROR, MessageKind.EOS)
    index = next((index for index, message in enumerate(messages) if message.kind not in kept), 0)
    return range(index, index + 1 if is_full else index)
