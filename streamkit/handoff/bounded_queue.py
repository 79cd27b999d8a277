"""BoundedQueue: a queue between threads, bounded by items and bytes; losses are counted."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Generic, TypeAlias, TypeVar

Item = TypeVar("Item")
ChooseDropped: TypeAlias = Callable[[Sequence[Item], Item, bool], range]
POLL_S = 0.5  # interval at which waits check whether to end, in case a notification is missed


def wait_until(
    changed: threading.Condition,
    condition: Callable[[], bool],
    limit_s: float | None,
    cancelled: threading.Event | None = None,
) -> None:
    """Waits until a condition holds, with the lock of `changed` held.

    The wait also ends after `limit_s` (None: no limit), and within half a second once `cancelled` is set.
    """
    deadline = None if limit_s is None else time.monotonic() + limit_s
    while not condition() and not (cancelled is not None and cancelled.is_set()):
        left_s = POLL_S if deadline is None else min(POLL_S, deadline - time.monotonic())
        if left_s <= 0:
            return
        changed.wait(left_s)


class BoundedQueue(Generic[Item]):
    """A first-in first-out queue between threads.

    In a full queue `put` waits for room, then drops the oldest. An empty queue takes an item of any size.

    Args:
        capacity: maximum number of items; 0 is no limit.
        max_bytes: maximum sum of sizes; 0 is no limit.
        choose_dropped: called by `put` with the queued items, the oldest first, the new item, and whether the
            queue is full; returns the indices to drop, where the last + 1 is the new item. If the queue is
            still full, the oldest are dropped.

    Attributes:
        bytes: sum of the sizes of the items it holds.
        dropped: number of items so far that were not taken.
    """

    def __init__(
        self, capacity: int = 0, max_bytes: int = 0, choose_dropped: ChooseDropped[Item] | None = None
    ) -> None:
        self._capacity = capacity
        self._max_bytes = max_bytes
        self._choose_dropped = choose_dropped
        self._items: deque[Item] = deque()
        self._sizes: deque[int] = deque()
        self._changed = threading.Condition()
        self.bytes = self.dropped = 0
        self._has_ended = self._is_closed = False
        self._error: Exception | None = None

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item, size: int = 0, *, wait_s: float | None = 0.0) -> int:
        """Adds an item; in a full queue waits for room, then drops others.

        Args:
            item: the item; ignored once the queue is closed.
            size: of the item, bytes.
            wait_s: maximum wait for room, s; None waits until there is room or the queue is closed.

        Returns:
            Number of dropped items, including the new one.
        """
        with self._changed:
            wait_until(self._changed, lambda: self._is_closed or not self._is_full(size), wait_s)
            if self._is_closed:
                return 0
            before = self.dropped
            if self._make_room(item, size):
                self._items.append(item)
                self._sizes.append(size)
                self.bytes += size
                self._changed.notify_all()
            return self.dropped - before

    def get(self, wait_s: float | None = 0.0, cancelled: threading.Event | None = None) -> Item | None:
        """Takes the oldest item.

        Args:
            wait_s: maximum wait, s; None waits until an item arrives or the queue ends.
            cancelled: ends the wait within half a second when set.

        Returns:
            The item; None at the timeout or the end.

        Raises:
            Exception: the one given to `end`, once all items are taken.
        """
        with self._changed:
            wait_until(self._changed, lambda: bool(self._items) or self._has_ended, wait_s, cancelled)
            if not self._items:
                if self._error is not None:
                    raise self._error
                return None
            self.bytes -= self._sizes.popleft()
            self._changed.notify_all()
            return self._items.popleft()

    def end(self, error: Exception | None = None) -> None:
        """Ends the queue after the items it holds, optionally with an error for the reader."""
        with self._changed:
            self._has_ended, self._error = True, error
            self._changed.notify_all()

    def reopen(self) -> None:
        """Undoes `end`, but not `close`."""
        with self._changed:
            self._has_ended, self._error = self._is_closed, None

    def close(self) -> int:
        """Drops all items, ignores later ones and wakes waiting threads; returns the number dropped."""
        with self._changed:
            self._is_closed = self._has_ended = True
            return self._clear()

    def clear(self) -> int:
        """Drops all items; returns their number."""
        with self._changed:
            return self._clear()

    def wake(self) -> None:
        """Makes waiting threads check their `cancelled` event."""
        with self._changed:
            self._changed.notify_all()

    @property
    def is_over(self) -> bool:
        """Whether the queue is empty and has ended."""
        with self._changed:
            return self._has_ended and not self._items

    # With the lock held.

    def _is_full(self, size: int) -> bool:
        if not self._items:
            return False
        too_many = 0 < self._capacity <= len(self._items)
        return too_many or (self._max_bytes > 0 and self.bytes + size > self._max_bytes)

    def _make_room(self, item: Item, size: int) -> bool:
        """Drops the items of `choose_dropped`, then the oldest; whether the new item is to be added."""
        held, chosen = len(self._items), range(0)
        if self._choose_dropped is not None:
            chosen = self._choose_dropped(self._items, item, self._is_full(size))
        for index in reversed(chosen):
            if index < held:
                self._drop(index)
        if held in chosen:
            self.dropped += 1
            return False
        while self._is_full(size):
            self._drop(0)
        return True

    def _drop(self, index: int) -> None:
        self.bytes -= self._sizes[index]
        del self._items[index], self._sizes[index]
        self.dropped += 1

    def _clear(self) -> int:
        dropped = len(self._items)
        self._items.clear()
        self._sizes.clear()
        self.bytes = 0
        self.dropped += dropped
        self._changed.notify_all()
        return dropped
