"""BoundedQueue: items between threads, bounded by number and by bytes, every loss counted."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

Item = TypeVar("Item")
LOOK_S = 0.5  # longest sleep between looks, should a wake-up be missed


@dataclass(frozen=True, slots=True)
class QueueStatistics:
    """What a queue holds and has seen.

    Attributes:
        items: items held now.
        bytes: their sizes added up.
        received: items put in so far.
        taken: items taken out so far.
        dropped: items that were put in and will not be taken.
    """

    items: int
    bytes: int
    received: int
    taken: int
    dropped: int


class BoundedQueue(Generic[Item]):
    """A first-in first-out queue between threads.

    A full queue makes room as `put` asks: it waits for a while, then drops the oldest. One item always fits.

    Args:
        capacity: most items held; 0 is no limit.
        max_bytes: most bytes held; 0 is no limit.
        choose_dropped: index of the item to drop from a full queue, the oldest first; None is the oldest.
    """

    def __init__(
        self, capacity: int = 0, max_bytes: int = 0, choose_dropped: Callable[[list[Item]], int] | None = None
    ) -> None:
        self._capacity = capacity
        self._max_bytes = max_bytes
        self._choose_dropped = choose_dropped
        self._items: deque[tuple[Item, int]] = deque()
        self._changed = threading.Condition()
        self._bytes = self._received = self._taken = self._dropped = 0
        self._has_ended = self._is_closed = False
        self._error: Exception | None = None

    def __len__(self) -> int:
        return len(self._items)

    @property
    def statistics(self) -> QueueStatistics:
        """What it holds and has seen, all of one moment."""
        with self._changed:
            return QueueStatistics(len(self._items), self._bytes, self._received, self._taken, self._dropped)

    def put(
        self,
        item: Item,
        size: int = 0,
        *,
        wait_s: float | None = 0.0,
        cancelled: threading.Event | None = None,
    ) -> int:
        """Adds an item; in a full queue waits for room, then drops others.

        Args:
            item: the item; ignored once the queue is closed.
            size: its bytes.
            wait_s: longest wait for room, s; None waits until there is room or the queue is closed.
            cancelled: ends the wait when set, within half a second.

        Returns:
            How many items were dropped to make room.
        """
        with self._changed:
            self._wait(lambda: not self._is_full(size), wait_s, cancelled)
            if self._is_closed:
                return 0
            dropped = 0
            while self._is_full(size):
                self._drop_one()
                dropped += 1
            self._items.append((item, size))
            self._bytes += size
            self._received += 1
            self._changed.notify_all()
            return dropped

    def get(self, wait_s: float | None = 0.0, cancelled: threading.Event | None = None) -> Item | None:
        """Takes the oldest item.

        Args:
            wait_s: longest wait for one, s; None waits until one comes or none will.
            cancelled: ends the wait when set, within half a second.

        Returns:
            The item; None where none has come in time, or none will.

        Raises:
            Exception: the one given to `end`, once every item has been taken.
        """
        with self._changed:
            self._wait(lambda: bool(self._items) or self._has_ended, wait_s, cancelled)
            if not self._items:
                if self._error is not None:
                    raise self._error
                return None
            item, size = self._items.popleft()
            self._bytes -= size
            self._taken += 1
            self._changed.notify_all()
            return item

    def end(self, error: Exception | None = None) -> None:
        """No item follows those put in, because the stream is over or because of an error."""
        with self._changed:
            self._has_ended, self._error = True, error
            self._changed.notify_all()

    def reopen(self) -> None:
        """Takes `end` back: items follow after all; a closed queue stays closed."""
        with self._changed:
            self._has_ended, self._error = self._is_closed, None

    def close(self) -> int:
        """Drops what is held and ignores what comes; wakes who waits. How many items were dropped."""
        with self._changed:
            self._is_closed = self._has_ended = True
            return self._clear()

    def clear(self) -> int:
        """Drops what is held; how many items that were."""
        with self._changed:
            return self._clear()

    def wake(self) -> None:
        """Has every waiting thread look at its `cancelled` event."""
        with self._changed:
            self._changed.notify_all()

    @property
    def is_over(self) -> bool:
        """Whether nothing is held and nothing follows."""
        with self._changed:
            return self._has_ended and not self._items

    def wait_empty(self, wait_s: float, cancelled: threading.Event | None = None) -> bool:
        """Waits until every item has been taken, for as long as one is taken every `wait_s`; whether so."""
        with self._changed:
            while self._items and not self._is_closed:
                taken = self._taken
                self._wait(lambda taken=taken: self._taken != taken, wait_s, cancelled)  # type: ignore[misc]
                if self._taken == taken:
                    break
            return not self._items

    # With the lock held.

    def _wait(
        self, condition: Callable[[], bool], wait_s: float | None, cancelled: threading.Event | None
    ) -> None:
        deadline = None if wait_s is None else time.monotonic() + wait_s
        while not condition() and not self._is_closed and not (cancelled is not None and cancelled.is_set()):
            left_s = LOOK_S if deadline is None else min(LOOK_S, deadline - time.monotonic())
            if left_s <= 0:
                return
            self._changed.wait(left_s)

    def _is_full(self, size: int) -> bool:
        if not self._items:
            return False
        too_many = 0 < self._capacity <= len(self._items)
        return too_many or (self._max_bytes > 0 and self._bytes + size > self._max_bytes)

    def _drop_one(self) -> None:
        index = 0
        if self._choose_dropped is not None:
            index = self._choose_dropped([item for item, _ in self._items])
        self._bytes -= self._items[index][1]
        del self._items[index]
        self._dropped += 1

    def _clear(self) -> int:
        dropped = len(self._items)
        self._items.clear()
        self._bytes = 0
        self._dropped += dropped
        self._changed.notify_all()
        return dropped
