"""Bounded queue of packets between the thread that reads and the one that uses them; keeps the newest.

It is no `BoundedQueue`, which drops one item when full: this one also drops by age, always up to a key frame,
and may refuse packets until the next key frame.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

Item = TypeVar("Item")
# Streams with intra refresh have no key frames: after so many refused packets the next one is accepted.
KEYFRAME_PATIENCE = 300


class PacketQueue(Generic[Item]):
    """Queues packets; when full it drops the oldest up to a key frame, so that frames stay decodable.

    Args:
        capacity: most packets queued.
        longest_wait_s: once the oldest packet has waited longer, the next key frame replaces all before it.

    Attributes:
        received: packets put in so far.
        dropped: of them, those that were not and will not be taken.
    """

    def __init__(self, capacity: int, longest_wait_s: float = float("inf")) -> None:
        self.received = self.dropped = 0
        self._capacity = capacity
        self._longest_wait_s = longest_wait_s
        self._items: deque[tuple[Item, bool, float]] = deque()
        self._changed = threading.Condition()
        self._reported = self._refused = 0
        self._awaits_keyframe = self._has_ended = False
        self._error: Exception | None = None

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item, is_keyframe: bool, now_s: float = 0.0) -> None:
        """Adds the newest packet; never waits.

        Args:
            item: the packet.
            is_keyframe: whether decoding can begin with it.
            now_s: a monotonic clock, s.
        """
        with self._changed:
            self.received += 1
            if self._awaits_keyframe and not is_keyframe and self._refused < KEYFRAME_PATIENCE:
                self.dropped += 1
                self._refused += 1
                return
            self._awaits_keyframe, self._refused = False, 0
            if len(self._items) >= self._capacity:
                if not self._jump(is_keyframe):
                    self.dropped += len(self._items) + 1
                    self._items.clear()
                    self._awaits_keyframe = True
                    return
            elif self._items and now_s - self._items[0][2] > self._longest_wait_s:
                self._jump(is_keyframe)
            self._items.append((item, is_keyframe, now_s))
            self._changed.notify_all()

    def _jump(self, next_is_keyframe: bool) -> int:
        """Drops the packets before the newest key frame and returns their number; 0 where there is none."""
        keyframes = (at for at in range(len(self._items) - 1, 0, -1) if self._items[at][1])
        count = len(self._items) if next_is_keyframe else next(keyframes, 0)
        for _ in range(count):
            self._items.popleft()
        self.dropped += count
        return count

    def take(self, timeout_s: float) -> Item | None:
        """Takes the oldest packet, and waits for one.

        Returns:
            None after the time limit, after `wake`, or at the end.

        Raises:
            Exception: the one given to `end`, after the last packet.
        """
        with self._changed:
            if not self._items and not self._has_ended:
                self._changed.wait(timeout_s)
            if self._items:
                return self._items.popleft()[0]
            if self._error is not None:
                raise self._error
            return None

    def end(self, error: Exception | None = None) -> None:
        """No packet follows, because the stream is over or because of an error."""
        with self._changed:
            self._has_ended, self._error = True, error
            self._changed.notify_all()

    def wake(self) -> None:
        """Makes a waiting `take` return."""
        with self._changed:
            self._changed.notify_all()

    @property
    def is_over(self) -> bool:
        """Whether the reader has ended and every packet has been taken."""
        with self._changed:
            return self._has_ended and not self._items

    def take_dropped(self) -> int:
        """Packets dropped since the last call."""
        with self._changed:
            new, self._reported = self.dropped - self._reported, self.dropped
            return new
