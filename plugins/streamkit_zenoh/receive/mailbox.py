"""A bounded box between zenoh's thread, which puts in, and the source's, which takes out."""

import threading
from collections import deque
from typing import Generic, TypeVar

Item = TypeVar("Item")


class Mailbox(Generic[Item]):
    """Holds items in order, at most so many and so many bytes.

    Args:
        capacity: most items held.
        limit_bytes: most bytes held; one item always fits.
        newest: full, drop the oldest; else let the giver wait, and through zenoh the publisher.

    Attributes:
        dropped: items dropped so far.
    """

    def __init__(self, capacity: int, limit_bytes: int, newest: bool) -> None:
        self.dropped = 0
        self._capacity = capacity
        self._limit_bytes = limit_bytes
        self._newest = newest
        self._items: deque[tuple[Item, int]] = deque()
        self._bytes = 0
        self._closed = False
        self._ended = False
        self._changed = threading.Condition()

    def put(self, item: Item, size: int) -> None:
        """Gives an item of so many bytes; waits for room unless the oldest may be dropped."""
        with self._changed:
            while self._is_full(size) and not self._closed:
                if self._newest:
                    self._bytes -= self._items.popleft()[1]
                    self.dropped += 1
                else:
                    self._changed.wait()
            if self._closed:
                return
            self._items.append((item, size))
            self._bytes += size
            self._changed.notify_all()

    def _is_full(self, size: int) -> bool:
        over = self._bytes + size > self._limit_bytes
        return bool(self._items) and (over or len(self._items) >= self._capacity)

    def take(self, limit_s: float) -> Item | None:
        """The oldest item, or None when none has come within the limit or none will."""
        with self._changed:
            if not self._items and not self._closed and not self._ended:
                self._changed.wait(limit_s)
            if not self._items:
                return None
            item, size = self._items.popleft()
            self._bytes -= size
            self._changed.notify_all()
            return item

    def end(self, ended: bool = True) -> None:
        """Tells that no item follows those given, or takes that back."""
        with self._changed:
            self._ended = ended
            self._changed.notify_all()

    def close(self) -> None:
        """Wakes whoever waits; items given from now on are lost."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def is_over(self) -> bool:
        """Whether nothing is left and nothing follows."""
        with self._changed:
            return self._closed or (self._ended and not self._items)
