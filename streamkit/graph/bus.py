"""Bus: messages from all threads of a graph to the application."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from streamkit.flow.messages import Message, MessageKind

CAPACITY = 4096
POLL_S = 0.2


class Bus:
    """A bounded queue of messages; if full, it drops the oldest that is neither error nor eos.

    Attributes:
        lost: number of dropped messages.
    """

    def __init__(self) -> None:
        self._messages: deque[Message] = deque()
        self._changed = threading.Condition()
        self._watchers: list[Callable[[Message], None]] = []
        self.lost = 0

    def post(self, message: Message) -> None:
        """Queues a message; watchers are called with it in the posting thread."""
        for watcher in tuple(self._watchers):
            watcher(message)
        with self._changed:
            if len(self._messages) >= CAPACITY:
                self._drop_one()
            self._messages.append(message)
            self._changed.notify()

    def _drop_one(self) -> None:
        kept = (MessageKind.ERROR, MessageKind.EOS)
        index = next((i for i, message in enumerate(self._messages) if message.kind not in kept), 0)
        del self._messages[index]
        self.lost += 1

    def flush(self) -> None:
        """Discards unread messages."""
        with self._changed:
            self._messages.clear()

    def watch(self, watcher: Callable[[Message], None]) -> None:
        """Calls a function with every message, in the thread that posts it."""
        self._watchers.append(watcher)

    def pop(self, timeout_s: float | None = 0.0, kinds: tuple[MessageKind, ...] = ()) -> Message | None:
        """The next message, of one of `kinds` if any are given; None at the timeout.

        Args:
            timeout_s: maximum wait; None has no limit, but Ctrl-C ends it.
            kinds: other messages are discarded while waiting.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            with self._changed:
                while self._messages:
                    message = self._messages.popleft()
                    if not kinds or message.kind in kinds:
                        return message
                left_s = POLL_S if deadline is None else deadline - time.monotonic()
                if left_s <= 0:
                    return None
                self._changed.wait(min(left_s, POLL_S))
