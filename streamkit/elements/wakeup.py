"""Wakeup: what one thread sleeps on until another wakes it."""

from __future__ import annotations

import _thread


class Wakeup:
    """A sign that one thread leaves for one other; left twice, it is found once.

    `threading.Event` does the same for any number of sleepers, at ten times the cost: it makes a lock for
    each sleep.
    """

    __slots__ = ("_lock",)

    def __init__(self) -> None:
        self._lock = _thread.allocate_lock()
        self._lock.acquire()

    def set(self) -> None:
        """Leaves the sign, and wakes whoever waits for it."""
        try:
            self._lock.release()
        except RuntimeError:  # it was there already
            return

    def wait(self, limit_s: float) -> bool:
        """Sleeps until the sign is there, and takes it; whether it came within the limit."""
        return self._lock.acquire(timeout=limit_s)
