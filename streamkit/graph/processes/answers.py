"""Answers: what the orders to a child wait for."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from typing import Any

from streamkit.errors import ProcessDied
from streamkit.graph.processes.orders import OrderResult, decode_failure


class Answers:
    """A future for each order without an answer, by its number; safe in any thread.

    Each gets the answer that arrives, or `ProcessDied` by `fail` or `end`, whichever is first.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._newest = 0
        self._waiting: dict[int, Future[Any]] = {}
        self._end = ""  # why no more answers arrive

    def expect(self) -> tuple[int, Future[Any]]:
        """The number of the next order, and the future that gets its answer."""
        answer = Future[Any]()
        with self._lock:
            self._newest += 1
            if self._end:
                answer.set_exception(ProcessDied(self._end))
            else:
                self._waiting[self._newest] = answer
            return self._newest, answer

    def arrived(self, result: OrderResult) -> None:
        """An order has ended; one that no longer waits is no matter."""
        with self._lock:
            answer = self._waiting.pop(result.number, None)
        if answer is None:
            return
        if result.failure is None:
            answer.set_result(result.value)
        else:
            answer.set_exception(decode_failure(result.failure))

    def fail(self, number: int, reason: str) -> None:
        """An order was not sent."""
        with self._lock:
            answer = self._waiting.pop(number, None)
        if answer is not None:
            answer.set_exception(ProcessDied(reason))

    def end(self, reason: str) -> None:
        """No more answers arrive: ends those that are waited for, and all that follow."""
        with self._lock:
            self._end = reason
            waiting, self._waiting = list(self._waiting.values()), {}
        for answer in waiting:
            answer.set_exception(ProcessDied(reason))
