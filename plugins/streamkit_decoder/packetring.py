"""A bounded line of packets between the thread that reads and the one that uses them: the newest wins."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

Item = TypeVar("Item")


class PacketRing(Generic[Item]):
    """Holds packets; when full it drops the oldest, always up to a key frame, so that pictures stay whole.

    Args:
        capacity: packets held at most.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._items: deque[tuple[Item, bool]] = deque()
        self._changed = threading.Condition()
        self._dropped = 0
        self._awaits_keyframe = False
        self._ended = False
        self._error: Exception | None = None

    def put(self, item: Item, is_keyframe: bool) -> None:
        """Adds the newest packet; never waits."""
        with self._changed:
            if self._awaits_keyframe and not is_keyframe:
                self._dropped += 1
                return
            self._awaits_keyframe = False
            if len(self._items) >= self.capacity:
                self._make_room(is_keyframe)
                if self._awaits_keyframe:
                    self._dropped += 1
                    return
            self._items.append((item, is_keyframe))
            self._changed.notify_all()

    def _make_room(self, next_is_keyframe: bool) -> None:
        """Drops up to the newest key frame; everything where that is the packet to come or none is held."""
        keyframes = [position for position, (_, is_keyframe) in enumerate(self._items) if is_keyframe]
        newest = keyframes[-1] if keyframes and not next_is_keyframe else 0
        if newest == 0:
            self._dropped += len(self._items)
            self._items.clear()
            self._awaits_keyframe = not next_is_keyframe
            return
        for _ in range(newest):
            self._items.popleft()
        self._dropped += newest

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
            dropped, self._dropped = self._dropped, 0
            return dropped
