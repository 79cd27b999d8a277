"""Timing: the running time of a pipeline, which stops while it is paused."""

from __future__ import annotations

import threading
from collections.abc import Callable

from streamkit.flow.clock import Clock


class Timing:
    """Maps running time, which starts at the first frame, to the pipeline's clock.

    Attributes:
        running: set while the pipeline plays.
        latency_ns: added to every due time, so that live frames are not late.

    Source: GStreamer's base time: clock time = base time + running time.
    """

    def __init__(self, clock: Callable[[], Clock]) -> None:
        self.running = threading.Event()
        self.running.set()
        self.latency_ns = 0
        self._clock = clock
        self._lock = threading.Lock()
        self._base_ns: int | None = None
        self._paused_ns: int | None = None

    def reset(self) -> None:
        """Lets running time start again with the next frame that is due."""
        with self._lock:
            self._base_ns = self._paused_ns = None
            self.latency_ns = 0
        self.running.set()

    def begin(self) -> None:
        """Starts running time now, for live sources."""
        with self._lock:
            if self._base_ns is None:
                self._base_ns = self._clock().monotonic_ns()

    def pause(self) -> None:
        """Stops running time."""
        self.running.clear()
        with self._lock:
            if self._base_ns is not None and self._paused_ns is None:
                self._paused_ns = self._clock().monotonic_ns() - self._base_ns

    def resume(self) -> None:
        """Resumes running time."""
        with self._lock:
            if self._paused_ns is not None:
                self._base_ns = self._clock().monotonic_ns() - self._paused_ns
                self._paused_ns = None
        self.running.set()

    def follow(self, base_ns: int | None, latency_ns: int) -> None:
        """Takes over the clock time of running time 0, if it is known, and the latency of another process."""
        with self._lock:
            self._base_ns = base_ns
            self.latency_ns = latency_ns

    @property
    def base_ns(self) -> int | None:
        """Clock time of running time 0, ns; None before it starts."""
        with self._lock:
            return self._base_ns

    def running_time_ns(self) -> int:
        """Current running time, ns; 0 before it starts."""
        with self._lock:
            if self._paused_ns is not None:
                return self._paused_ns
            return 0 if self._base_ns is None else self._clock().monotonic_ns() - self._base_ns

    def due_ns(self, running_time_ns: int) -> int:
        """Clock time of a running time, ns; the first call starts running time so that it is due at once."""
        with self._lock:
            if self._base_ns is None:
                self._base_ns = self._clock().monotonic_ns() - running_time_ns
            return self._base_ns + running_time_ns + self.latency_ns
