"""A bounded line of packets between the thread that reads and the one that uses them: the newest wins."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

Item = TypeVar("Item")
# Streams that refresh a picture bit by bit have no key frames at all: after so many packets it goes on.
KEYFRAME_PATIENCE = 300


class PacketRing(Generic[Item]):
    """Holds packets; when full it drops the oldest, always up to a key frame, so that pictures stay whole.

    Args:
        capacity: packets held at most.
        longest_wait_s: once the oldest packet has waited longer, the next key frame takes over.

    Attributes:
        received: packets put in so far.
        dropped: of them, those that were not and will not be taken.
    """

    def __init__(self, capacity: int, longest_wait_s: float = float("inf")) -> None:
        self.capacity = capacity
        self.received = 0
        self.dropped = 0
        self._longest_wait_s = longest_wait_s
        self._items: deque[tuple[Item, bool, float]] = deque()
        self._changed = threading.Condition()
        self._told = 0
        self._refused = 0
        self._awaits_keyframe = False
        self._ended = False
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
            if len(self._items) >= self.capacity:
                self._make_room(is_keyframe)
                if self._awaits_keyframe:
                    self.dropped += 1
                    return
            elif self._items and now_s - self._items[0][2] > self._longest_wait_s:
                self._jump(is_keyframe)
            self._items.append((item, is_keyframe, now_s))
            self._changed.notify_all()

    def _newest_keyframe(self) -> int:
        """Its position among the packets held; 0 where there is none behind the first."""
        return max((at for at, (_, is_keyframe, _) in enumerate(self._items) if is_keyframe), default=0)

    def _jump(self, next_is_keyframe: bool) -> None:
        """Drops up to the newest key frame; nothing where there is none."""
        count = len(self._items) if next_is_keyframe else self._newest_keyframe()
        for _ in range(count):
            self._items.popleft()
        self.dropped += count

    def _make_room(self, next_is_keyframe: bool) -> None:
        """Drops up to the newest key frame; everything where there is none."""
        before = len(self._items)
        self._jump(next_is_keyframe)
        if len(self._items) == before:
            self.dropped += before
            self._items.clear()
            self._awaits_keyframe = True

    def take(self, timeout_s: float) -> Item | None:
        """The oldest packet held, waiting for one if need be.

        Returns:
            None when the time is over, when woken, or at the end.

        Raises:
            Exception: the one that the reading side ended with, after its last packet.
        """
        with self._changed:
            if not self._items and not self._ended:
                self._changed.wait(timeout_s)
            if self._items:
                return self._items.popleft()[0]
            if self._error is not None:
                raise self._error
            return None

    def end(self, error: Exception | None = None) -> None:
        """No packet follows, because the stream is over or because of an error."""
        with self._changed:
            self._ended, self._error = True, error
            self._changed.notify_all()

    def wake(self) -> None:
        """Makes a waiting `take` come back."""
        with self._changed:
            self._changed.notify_all()

    @property
    def is_over(self) -> bool:
        """Whether the reading side has ended and every packet has been taken."""
        with self._changed:
            return self._ended and not self._items

    def take_dropped(self) -> int:
        """Packets dropped since the last call."""
        with self._changed:
            new, self._told = self.dropped - self._told, self.dropped
            return new
