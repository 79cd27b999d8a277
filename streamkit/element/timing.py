"""Timing: the running time of a pipeline, which stands still while it is paused."""

from __future__ import annotations

import threading
from collections.abc import Callable

from streamkit.flow.clock import Clock


class Timing:
    """Maps running time, which counts from the first frame, to the pipeline's clock.

    Attributes:
        running: set while the pipeline plays; sinks and synchronised elements wait for it.
        latency_ns: added to every due time, so that live frames that took a while on their way are not late.

    Source: GStreamer's base time: clock time = base time + running time.
    """

    def __init__(self, clock: Callable[[], Clock]) -> None:
        self.running = threading.Event()
        self.running.set()
        self.latency_ns = 0
        self._clock = clock
        self._lock = threading.Lock()
        self._base_ns: int | None = None
        self._held_ns: int | None = None

    def reset(self) -> None:
        """Forgets the run: running time begins anew with the next frame that is due."""
        with self._lock:
            self._base_ns = self._held_ns = None
            self.latency_ns = 0

    def begin(self) -> None:
        """Running time is 0 now: for live sources, whose time does not wait for the first frame."""
        with self._lock:
            if self._base_ns is None:
                self._base_ns = self._clock().monotonic_ns()

    def hold(self) -> None:
        """Running time stands still."""
        self.running.clear()
        with self._lock:
            if self._base_ns is not None and self._held_ns is None:
                self._held_ns = self._clock().monotonic_ns() - self._base_ns

    def go_on(self) -> None:
        """Running time goes on where it stood."""
        with self._lock:
            if self._held_ns is not None:
                self._base_ns = self._clock().monotonic_ns() - self._held_ns
                self._held_ns = None
        self.running.set()

    def running_time_ns(self) -> int:
        """The running time now, ns; 0 before it has begun."""
        with self._lock:
            if self._held_ns is not None:
                return self._held_ns
            return 0 if self._base_ns is None else self._clock().monotonic_ns() - self._base_ns

    def due_ns(self, running_time_ns: int) -> int:
        """The clock time of a running time, ns; the first one asked for is due at once."""
        with self._lock:
            if self._base_ns is None:
                self._base_ns = self._clock().monotonic_ns() - running_time_ns
            return self._base_ns + running_time_ns + self.latency_ns
