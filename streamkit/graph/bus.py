"""The bus: messages from every thread of a graph to its application."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable

from streamkit.flow.messages import Message, MessageKind

CAPACITY = 4096


class Bus:
    """A bounded line of messages; when full, the oldest that is neither error nor eos is lost and counted.

    Attributes:
        lost: messages dropped because nobody read them.
    """

    def __init__(self) -> None:
        self._messages: queue.Queue[Message] = queue.Queue(CAPACITY)
        self._watchers: list[Callable[[Message], None]] = []
        self.lost = 0

    def post(self, message: Message) -> None:
        """Adds a message; watchers see it at once, in the posting thread."""
        for watcher in self._watchers:
            watcher(message)
        while True:
            try:
                self._messages.put_nowait(message)
            except queue.Full:
                self._drop_one()
            else:
                return

    def _drop_one(self) -> None:
        try:
            oldest = self._messages.get_nowait()
        except queue.Empty:
            return
        self.lost += 1
        if oldest.kind in (MessageKind.ERROR, MessageKind.EOS) and not self._messages.full():
            self._messages.put_nowait(oldest)

    def watch(self, watcher: Callable[[Message], None]) -> None:
        """Calls a function with every message, in the thread that posts it."""
        self._watchers.append(watcher)

    def pop(self, timeout_s: float | None = 0.0, kinds: tuple[MessageKind, ...] = ()) -> Message | None:
        """The next message of the kinds wanted (all where none are named); None when the time is over.

        Args:
            timeout_s: longest wait; None waits in steps that Ctrl-C can end.
            kinds: other messages are discarded while waiting.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            left = 0.2 if deadline is None else max(0.0, deadline - time.monotonic())
            try:
                message = self._messages.get(timeout=min(left, 0.2)) if left else self._messages.get_nowait()
            except queue.Empty:
                if deadline is not None and time.monotonic() >= deadline:
                    return None
                continue
            if not kinds or message.kind in kinds:
                return message
