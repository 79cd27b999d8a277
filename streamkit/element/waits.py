"""Waits: how an element waits, what ends its waits, and the running time by which it does."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from streamkit.flow.clock import Clock, SystemClock
from streamkit.flow.events import Flushing
from streamkit.handoff.bounded_queue import POLL_S, wait_until

if TYPE_CHECKING:
    from streamkit.flow.frame import Frame


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


class Waits:
    """The waits of an element.

    A wait for data (`wait_for`) or for a time (`wait_until_due`) ends at a stop and at a flush. A flush may
    begin and end while a thread does not look: a wait is also over once `flushes` has grown.

    Attributes:
        stopping: set while the pipeline stops; every wait of an element checks it.
        clock: the pipeline's clock.
        timing: the pipeline's running time.
        lock: guards state that threads of the element share.
        changed: the condition on `lock` to wait on; `wake` notifies it, as each change of state does.
        is_flushing: whether a flush is in progress; frames are refused.
        flushes: number of flushes started.
        activity: name, start (perf_counter, ns) and frame of the current call by the engine, else None.
        is_waiting: whether the element waits on purpose; the watchdog then ignores it.
        waited_ns: time of calls with frames in which it waited on purpose, ns; not counted as work.
    """

    name: str

    def __init__(self) -> None:
        super().__init__()
        self.stopping = threading.Event()
        self.lock = threading.RLock()
        self.changed = threading.Condition(self.lock)
        self._state_changed = self.changed  # a class of an author may use that name
        self._woken = threading.Event()  # ends waits for a time of the clock
        self.is_flushing = self.is_waiting = False
        self.flushes = self.waited_ns = 0
        self.clock: Clock = SystemClock()
        self.timing = Timing(lambda: self.clock)
        self.activity: tuple[str, int, Frame | None] | None = None

    # Called by authors.

    def clock_ns(self) -> int:
        """The pipeline's monotonic clock, ns."""
        return self.clock.monotonic_ns()

    def wait_until_due(self, running_time_ns: int, delay_ns: int = 0) -> bool:
        """Waits until `delay_ns` after a running time, across pauses; False at a stop or flush."""
        flushes = self.flushes
        while not self.wait_on_clock(self.timing.due_ns(running_time_ns) + delay_ns):
            if not self.wait_while_paused(flushes):
                return False
        return True

    def wait_while_paused(self, flushes: int | None = None) -> bool:
        """Waits until the pipeline plays; False if it stops, flushes, or has begun to since `flushes`."""
        flushes = self.flushes if flushes is None else flushes
        with self.waiting():
            self.wait_for_state(lambda: self.timing.running.is_set() or self.must_give_up(flushes))
        return not self.must_give_up(flushes)

    def wait_for(self, condition: Callable[[], bool], poll_s: float = POLL_S) -> None:
        """Waits on `changed`, with its lock held, until a condition holds; checks it at least every `poll_s`.

        Raises:
            Flushing: the pipeline stops or flushes.
        """
        flushes = self.flushes
        while self.flushes != flushes or not condition():
            if self.must_give_up(flushes):
                raise Flushing(self.name)
            with self.waiting():
                self.changed.wait(poll_s)

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Context of a wait on purpose: the watchdog ignores the element."""
        before, self.is_waiting, began_ns = self.is_waiting, True, time.perf_counter_ns()
        try:
            yield
        finally:
            self.is_waiting = before
            if not before and self.activity is not None and self.activity[0] == "frame":
                self.waited_ns += time.perf_counter_ns() - began_ns

    def wake(self) -> None:
        """Makes every thread that waits look again at what it waits for."""
        with self._state_changed:
            self._woken.set()
            self._state_changed.notify_all()

    # Called by the engine.

    def halt(self) -> None:
        """Ends the element's waits because the pipeline stops."""
        self.stopping.set()
        self.wake()

    def flush(self, *, begins: bool) -> None:
        """Begins or ends a flush, which drops held frames and ends waits; called in the flushing thread."""
        with self._state_changed:
            self.is_flushing = begins
            if begins:
                self.flushes += 1
        self.wake()

    def await_frame_in_flight(self) -> None:
        """Waits until the frame that is on its way downstream has met a flush, which has begun there.

        For sources of frames that are older than the flush; a new frame may pass.
        """

    def must_give_up(self, flushes: int) -> bool:
        """Whether a wait has to end: the pipeline stops, flushes, or has begun to since `flushes`."""
        return self.stopping.is_set() or self.is_flushing or self.flushes != flushes

    def wait_on_clock(self, due_ns: int) -> bool:
        """Waits until a time of the clock; False once the element is woken, and while it is paused."""
        with self._state_changed:
            if self._woken.is_set():
                self._woken = threading.Event()
            woken = self._woken  # set by whatever changes from here on
            if self.must_give_up(self.flushes) or not self.timing.running.is_set():
                return False
        with self.waiting():
            return self.clock.wait_until(due_ns, woken)

    def wait_while_flushing(self) -> None:
        """Waits until no flush is in progress.

        Raises:
            Flushing: the pipeline stops.
        """
        self.wait_for_state(lambda: not self.is_flushing or self.stopping.is_set())
        if self.stopping.is_set():
            raise Flushing(self.name)

    def wait_for_state(self, condition: Callable[[], bool]) -> None:
        """Waits until a condition of the pipeline's state holds, whatever else ends waits."""
        with self._state_changed:
            wait_until(self._state_changed, condition, None)
