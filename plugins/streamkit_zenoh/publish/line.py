"""A bounded line of things to be sent, with a thread of its own, so that a slow network holds up nobody."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

LOOK_EVERY_S = 0.05

Item = TypeVar("Item")


class SendingLine(Generic[Item]):
    """Sends items in order, from its own thread.

    Args:
        send: sends one item; may block, and may raise.
        capacity: most items waiting.
        failed: called with what `send` or `tick` raised, from the sending thread.
        tick: called every `tick_every_s` from the sending thread, between two items.
        tick_every_s: 0 never calls it.
    """

    def __init__(
        self,
        send: Callable[[Item], None],
        capacity: int,
        failed: Callable[[Exception], None],
        tick: Callable[[], None] = lambda: None,
        tick_every_s: float = 0.0,
    ) -> None:
        self._send = send
        self._failed = failed
        self._capacity = capacity
        self._tick = tick
        self._tick_every_s = tick_every_s
        self._waiting: deque[Item] = deque()
        self._changed = threading.Condition()
        self._sent = 0
        self._idle = True
        self._busy = False
        self._congested = False
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="zenoh sender", daemon=False)
        self._thread.start()

    def submit(self, item: Item, patience_s: float, cancelled: threading.Event) -> int:
        """Lines an item up; with the line full, waits for room, and then drops the oldest.

        After one wait in vain there is no further wait until something has been sent: a dead network costs
        the stream `patience_s` once, not at every frame.

        Returns:
            How many items were dropped, 0 or 1.
        """
        with self._changed:
            full = len(self._waiting) >= self._capacity
            if full and patience_s > 0:
                full = not self._has_room_within(0.0 if self._congested else patience_s, cancelled)
            self._congested = full
            if full:
                self._waiting.popleft()
            self._waiting.append(item)
            if self._idle:
                self._changed.notify_all()
        return int(full)

    def _has_room_within(self, limit_s: float, cancelled: threading.Event) -> bool:
        left_s = limit_s
        while len(self._waiting) >= self._capacity and left_s > 0 and not cancelled.is_set():
            self._changed.wait(LOOK_EVERY_S)
            left_s -= LOOK_EVERY_S
        return len(self._waiting) < self._capacity

    def flush(self, patience_s: float, cancelled: threading.Event) -> int:
        """Waits until everything is sent, for as long as something is sent every `patience_s`.

        Returns:
            How many items are left.
        """
        with self._changed:
            sent, left_s = self._sent, patience_s
            while (
                (self._waiting or self._busy) and left_s > 0 and not cancelled.is_set() and not self._closed
            ):
                self._changed.wait(LOOK_EVERY_S)
                left_s = patience_s if self._sent != sent else left_s - LOOK_EVERY_S
                sent = self._sent
            return len(self._waiting) + self._busy

    def close(self) -> int:
        """Sends nothing more; an item being sent is not waited for.

        Returns:
            How many items are dropped.
        """
        with self._changed:
            self._closed = True
            left = len(self._waiting)
            self._waiting.clear()
            self._changed.notify_all()
        return left

    def join(self, limit_s: float) -> bool:
        """Whether the thread has ended after `close`, within the limit."""
        self._thread.join(limit_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        due_s = time.monotonic() + self._tick_every_s if self._tick_every_s else float("inf")
        while self._wait_until(due_s):
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + self._tick_every_s
                self._guarded(self._tick)
            item = self._next()
            if item is not None:
                self._guarded(lambda item=item: self._send(item))  # type: ignore[misc]
                with self._changed:
                    self._busy, self._congested = False, False
                    self._sent += 1
                    self._changed.notify_all()
                item = None

    def _guarded(self, call: Callable[[], None]) -> None:
        try:
            call()
        except Exception as error:
            self._failed(error)

    def _wait_until(self, due_s: float) -> bool:
        """Waits for an item or the time; False once the line is closed."""
        with self._changed:
            while not self._waiting and not self._closed:
                left_s = due_s - time.monotonic()
                if left_s <= 0:
                    break
                self._idle = True
                self._changed.wait(None if left_s == float("inf") else left_s)
            self._idle = False
            return not self._closed

    def _next(self) -> Item | None:
        with self._changed:
            if self._closed or not self._waiting:
                return None
            self._busy = True
            item = self._waiting.popleft()
            self._changed.notify_all()
            return item
