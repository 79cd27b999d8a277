"""A bounded line of records to be sent, with a thread of its own, so that a slow network holds up nobody."""

import threading
from collections import deque
from collections.abc import Callable

LOOK_EVERY_S = 0.05


class RecordSender:
    """Sends payloads in order, from its own thread.

    Args:
        send: sends one payload; may block, and may raise.
        capacity: most payloads waiting.
        failed: called with what `send` raised, from the sending thread.
    """

    def __init__(
        self, send: Callable[[bytes], None], capacity: int, failed: Callable[[Exception], None]
    ) -> None:
        self._send = send
        self._failed = failed
        self._capacity = capacity
        self._waiting: deque[bytes] = deque()
        self._changed = threading.Condition()
        self._sent = 0
        self._busy = False
        self._congested = False
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="zenoh sender", daemon=False)
        self._thread.start()

    def submit(self, payload: bytes, patience_s: float, cancelled: threading.Event) -> int:
        """Lines a payload up; with the line full, waits for room, and then drops the oldest.

        After one wait in vain there is no further wait until something has been sent: a dead network costs
        the stream `patience_s` once, not at every frame.

        Returns:
            How many payloads were dropped, 0 or 1.
        """
        with self._changed:
            left_s = 0.0 if self._congested else patience_s
            while len(self._waiting) >= self._capacity and left_s > 0 and not cancelled.is_set():
                self._changed.wait(LOOK_EVERY_S)
                left_s -= LOOK_EVERY_S
            self._congested = full = len(self._waiting) >= self._capacity
            if full:
                self._waiting.popleft()
            self._waiting.append(payload)
            self._changed.notify_all()
        return int(full)

    def flush(self, patience_s: float, cancelled: threading.Event) -> int:
        """Waits until everything is sent, for as long as something is sent every `patience_s`.

        Returns:
            How many payloads are left.
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
        """Sends nothing more; a payload being sent is not waited for.

        Returns:
            How many payloads are dropped.
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
        while (payload := self._next()) is not None:
            try:
                self._send(payload)
            except Exception as error:
                self._failed(error)
            with self._changed:
                self._busy, self._congested = False, False
                self._sent += 1
                self._changed.notify_all()

    def _next(self) -> bytes | None:
        with self._changed:
            while not self._waiting and not self._closed:
                self._changed.wait()
            if self._closed:
                return None
            self._busy = True
            payload = self._waiting.popleft()
            self._changed.notify_all()
            return payload
