"""queue: a bounded thread boundary."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from typing_extensions import override

from streamkit.element.frame_queue import FrameHolder
from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.property_text import UINT, UINT64, Choice
from streamkit.elements.frame_report import Callbacks
from streamkit.flow.caps import Caps
from streamkit.flow.events import (
    EndOfStream,
    EosEvent,
    Event,
    FlowStop,
    FlushEvent,
    Flushing,
    GapEvent,
    NotLinked,
)
from streamkit.flow.frame import Frame, FrameFlags
from streamkit.handoff.bounded_queue import POLL_S

PARK_S = 2.0  # longest wait of a flush for the frame in flight downstream


class Leaky(Choice):
    """The frame that a full queue drops."""

    NO = "no", 0, "Not Leaky"
    UPSTREAM = "upstream", 1, "Leaky on upstream (new buffers)"
    DOWNSTREAM = "downstream", 2, "Leaky on downstream (old buffers)"


class Queue(FrameHolder):
    """Runs downstream in its own thread; holds frames up to three limits.

    The queue is full if any level has reached its limit before a frame is added.

    At the start and at the end of a flush, the sink pad calls `flush`, then `receive_event`, in the flushing
    thread. From the start on, frames are refused, and the queue's thread parks. The end waits until it has,
    drops the frames, keeps the newest event of each kind, and takes frames again once downstream has flushed.

    Attributes:
        on_overrun: called with the queue when a frame arrives at a full queue.
        on_underrun: called with the queue when it becomes empty.
        on_running: called with the queue when frames arrive after that.

    Example:
        fakesrc num-buffers=100 ! queue max-size-buffers=10 ! fakesink
    """

    sink = src = "ANY"
    limits = ("max_size_buffers", "max_size_bytes", "max_size_time")

    max_size_buffers: int = Property(200, min=0, max=UINT, live=True, doc="Frame limit; 0 is none.")
    max_size_bytes: int = Property(
        10485760, min=0, max=UINT, live=True, unit="bytes", doc="Size limit; 0 is none."
    )
    max_size_time: int = Property(
        1_000_000_000, min=0, max=UINT64, live=True, unit="ns", doc="Time limit; 0 is none."
    )
    min_threshold_buffers: int = Property(
        0, min=0, max=UINT, live=True, doc="Frames to queue before reading."
    )
    min_threshold_bytes: int = Property(
        0, min=0, max=UINT, live=True, unit="bytes", doc="Bytes to queue before reading."
    )
    min_threshold_time: int = Property(
        0, min=0, max=UINT64, live=True, unit="ns", doc="Running time to queue before reading."
    )
    leaky: Leaky = Property(Leaky.NO, live=True, doc="Which frame a full queue drops instead of waiting.")
    flush_on_eos: bool = Property(False, live=True, doc="Drop queued frames at EOS.")
    silent: bool = Property(False, live=True, doc="Call none of the callbacks.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_overrun, self.on_underrun, self.on_running = Callbacks(), Callbacks(), Callbacks()
        # Guarded by `lock`, as `pending` is.
        self._waiting_threads = 0  # notifying is half of a crossing, so it is left out where none waits
        self._refusal: type[FlowStop] | None = None  # frames are refused: `Flushing` during a flush or stop
        self._has_tail_gap = self._has_head_gap = False  # a frame was dropped at that end
        self._pushing_thread = 0  # the thread that may be downstream, or 0
        super().__init__(name, **properties)

    def latency(self) -> tuple[int, int | None]:
        """From the time threshold to the time limit."""
        return self.min_threshold_time, self.max_size_time or None

    @override
    def query_caps(self, pad: Pad) -> Caps:
        return self.pads["sink" if pad.is_src else "src"].peer_caps()

    @override
    def apply_limits(self) -> None:
        with self.lock:
            self._has_thresholds = any(
                (self.min_threshold_buffers, self.min_threshold_bytes, self.min_threshold_time)
            )
            super().apply_limits()

    def _emit(self, callbacks: Callbacks) -> None:
        """Runs callbacks, without the lock, unless `silent`."""
        if callbacks and not self.silent:
            callbacks.emit(self)

    # Called in the upstream thread.

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        return self._put

    def _put(self, frame: Frame) -> None:
        self.lock.acquire()  # here and in `_take`, `with` would be a tenth of what a frame costs
        try:
            if self._refusal is not None:
                raise self._refused(self._refusal)
            if not self.pending.is_full():
                self._append(frame)
                return
        finally:
            self.lock.release()
        self._emit(self.on_overrun)
        with self.lock:
            if self._make_room():
                self._append(frame)

    def _append(self, frame: Frame) -> None:
        if self._has_tail_gap:
            self._has_tail_gap = False
            frame = frame.replace(flags=frame.flags | FrameFlags.DISCONTINUITY)
        self.pending.append(frame)
        if self._waiting_threads:
            self.changed.notify_all()

    def _wait(self) -> None:
        """Waits for a change, with the lock held."""
        self._waiting_threads += 1
        self.changed.wait(POLL_S)
        self._waiting_threads -= 1

    def _make_room(self) -> bool:
        """Waits, or drops by `leaky`; False if the new frame is dropped."""
        while self._refusal is None and self.pending.is_full():
            if self.leaky is Leaky.UPSTREAM:
                self.count_drop("queue full, newest dropped")
                self._has_tail_gap = True
                return False
            if self.leaky is Leaky.DOWNSTREAM and self.pending.drop_oldest():
                self.count_drop("queue full, oldest dropped")
                self._has_head_gap = True
                continue
            with self.waiting():
                self._wait()
        if self._refusal is not None:
            raise self._refused(self._refusal)
        return True

    def _refused(self, refusal: type[FlowStop]) -> FlowStop:
        """What to raise for a frame that is refused; a stop loses it here, a flush where it comes from."""
        if self.stopping.is_set():
            self.count_drop("pipeline stopped")
        return refusal(self.name)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Queues an event; a flush overtakes the frames."""
        if isinstance(event, FlushEvent):
            self.pads["src"].send_event(event)
        with self.lock:
            if isinstance(event, FlushEvent):
                if not event.begins and self._refusal is Flushing and not self.stopping.is_set():
                    self._refusal = None
            elif self._refusal in (None, Flushing):  # a flush keeps events
                if isinstance(event, EosEvent) and self.flush_on_eos:
                    self.count_drop("dropped at EOS", self.pending.drop_frames())
                self.pending.append(event)
            self.changed.notify_all()

    def flush(self, *, begins: bool) -> None:
        """Refuses frames during a flush; drops queued frames at its end. Called in the flushing thread."""
        pending = self.pending
        with self.lock:
            if begins:
                self._refusal = self._refusal or Flushing
            else:
                if self._pushing_thread != threading.get_ident():
                    self.changed.wait_for(lambda: not self._pushing_thread, PARK_S)
                newest = {
                    type(item): item for item in pending.items if not isinstance(item, Frame | GapEvent)
                }
                self.count_drop("flushed", pending.replace_with(list(newest.values())))
            super().flush(begins=begins)

    # Called in the queue's thread.

    @override
    def begin_run(self) -> None:
        super().begin_run()
        with self.lock:
            self.pending.reset()
            self._refusal = None
            self._has_head_gap = self._has_tail_gap = False

    def stream(self) -> None:
        """Body of the queue's thread: sends frames and events in order, until EOS."""
        src = self.pads["src"]
        self._pushing_thread = threading.get_ident()
        try:
            while True:
                item: Frame | Event | None = None
                flushes = self.flushes
                try:
                    item = self._take()
                    if isinstance(item, Frame):
                        src.push(item)
                    else:
                        src.send_event(item)
                except Flushing:
                    if item is not None and self.flushes == flushes:
                        raise  # not because of a flush
                    self._park(item)
                else:
                    if isinstance(item, EosEvent):
                        return
        except EndOfStream:
            self._refuse(EndOfStream)
        except NotLinked:
            had_ended = self.pads["sink"].has_upstream_ended
            self._refuse(NotLinked)
            if had_ended:  # else the next push raises it upstream
                raise
        except Exception as stop:
            self._refuse(type(stop) if isinstance(stop, FlowStop) else EndOfStream)
            raise
        finally:
            with self.lock:
                self._pushing_thread = 0
                self.changed.notify_all()
        src.send_eos()  # to branches that have not ended

    def _take(self) -> Frame | Event:
        """Waits until the queue may be read; takes the oldest item."""
        pending = self.pending
        while True:
            self.lock.acquire()
            try:
                if self._refusal is not None:
                    raise Flushing(self.name)
                if pending.items and (not self._has_thresholds or self._may_read()):
                    item = pending.popleft()
                    if self._waiting_threads:
                        self.changed.notify_all()
                    if self._has_head_gap and isinstance(item, Frame):
                        self._has_head_gap = False
                        item = item.replace(flags=item.flags | FrameFlags.DISCONTINUITY)
                    return item
                is_empty = not pending.items
            finally:
                self.lock.release()
            if is_empty:
                self._emit(self.on_underrun)
            with self.lock:
                while self._refusal is None and not self._may_read():
                    self._wait()
            self._emit(self.on_running)

    def _may_read(self) -> bool:
        """Whether the queue is past its thresholds, full, or has an event at its tail."""
        pending = self.pending
        if not pending.items or not self._has_thresholds:
            return bool(pending.items)
        is_past_thresholds = (
            pending.buffers >= self.min_threshold_buffers
            and pending.bytes >= self.min_threshold_bytes
            and pending.time_ns >= self.min_threshold_time
        )
        return is_past_thresholds or not isinstance(pending.items[-1], Frame) or pending.is_full()

    def _park(self, item: Frame | Event | None) -> None:
        """Waits until the flush ends that an item has met, which drops a frame, and keeps EOS.

        Raises:
            Flushing: the pipeline stops.
        """
        with self.lock:
            self._pushing_thread = 0
            self.changed.notify_all()
            while self._refusal is Flushing and not self.stopping.is_set():
                self._wait()
            if self.stopping.is_set():
                raise Flushing(self.name)
            self._pushing_thread = threading.get_ident()
            if isinstance(item, EosEvent):
                self.pending.append(item)
        if isinstance(item, Frame):
            self.count_drop("flushed")

    def _refuse(self, stop: type[FlowStop]) -> None:
        """Drops queued frames; every later push raises the reason."""
        with self.lock:
            self._refusal = stop
            reason = "pipeline stopped" if self.stopping.is_set() else "downstream has ended"
            self.count_drop(reason, self.pending.replace_with([]))
            self.changed.notify_all()

    def interrupt(self) -> None:
        """Wakes both threads, for good if the pipeline stops."""
        with self.lock:
            if self.stopping.is_set():
                self._refusal = self._refusal or Flushing
            self.changed.notify_all()

    @override
    def stop(self) -> None:
        with self.lock:
            self.count_drop("pipeline stopped", self.pending.replace_with([]))
