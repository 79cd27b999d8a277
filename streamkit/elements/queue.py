"""queue: a bounded thread boundary.

Frames cross without a lock: the thread upstream appends, the thread downstream takes, each counts on its own
side (see `Levels`), and one wakes the other only when that one sleeps.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from streamkit.element.choice import Choice
from streamkit.element.pad import WEIGHED, Pad
from streamkit.element.property import Property
from streamkit.elements.callbacks import Callbacks
from streamkit.elements.levels import EMPTY
from streamkit.elements.thread_boundary import LOOK_S, ThreadBoundary
from streamkit.flow.caps import Caps
from streamkit.flow.events import EosEvent, Event, FlushStart, FlushStop, SegmentEvent
from streamkit.flow.frame import Frame, FrameFlags
from streamkit.flow.signals import Flushing

UINT = 2**32 - 1
UINT64 = 2**64 - 1


class Leaky(Choice):
    """Which frame a full queue gives up."""

    NO = "no", 0, "Not Leaky"
    UPSTREAM = "upstream", 1, "Leaky on upstream (new buffers)"
    DOWNSTREAM = "downstream", 2, "Leaky on downstream (old buffers)"


class Queue(ThreadBoundary):
    """Lets what follows run in a thread of its own; holds frames up to three limits.

    It is full when any level has reached its limit, which is looked at before a frame is added.

    Attributes:
        on_overrun: called with the queue when a frame meets a full queue.

    Example:
        fakesrc num-buffers=100 ! queue max-size-buffers=10 ! fakesink
    """

    sink = src = "ANY"

    max_size_buffers: int = Property(
        200, min=0, max=UINT, live=True, doc="Frames held at most; 0 is no limit."
    )
    max_size_bytes: int = Property(
        10485760, min=0, max=UINT, live=True, unit="bytes", doc="Bytes held at most; 0 is no limit."
    )
    max_size_time: int = Property(
        1_000_000_000,
        min=0,
        max=UINT64,
        live=True,
        unit="ns",
        doc="Running time held at most; 0 is no limit.",
    )
    min_threshold_buffers: int = Property(
        0, min=0, max=UINT, live=True, doc="Frames to be held before any is handed on; 0 is none."
    )
    min_threshold_bytes: int = Property(
        0, min=0, max=UINT, live=True, unit="bytes", doc="Bytes to be held before any is handed on."
    )
    min_threshold_time: int = Property(
        0, min=0, max=UINT64, live=True, unit="ns", doc="Running time to be held before any is handed on."
    )
    leaky: Leaky = Property(Leaky.NO, live=True, doc="Which frame a full queue drops instead of waiting.")
    flush_on_eos: bool = Property(False, live=True, doc="Drop the frames held when EOS comes.")
    silent: bool = Property(False, live=True, doc="Call none of the callbacks.")
    current_level_buffers: int = Property(0, read=lambda q: q._levels.buffers, doc="Frames held now.")
    current_level_bytes: int = Property(
        0, read=lambda q: q._levels.bytes, unit="bytes", doc="Bytes held now."
    )
    current_level_time: int = Property(
        0, read=lambda q: q._levels.time_ns, unit="ns", doc="Running time held now."
    )

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_overrun = Callbacks()
        super().__init__(name, **properties)
        self.property_changed("")

    def _tell(self, callbacks: Callbacks) -> None:
        """Calls callbacks, unless the queue is to be silent."""
        if callbacks and not self.silent:
            callbacks.emit(self)

    def latency(self) -> tuple[int, int | None]:
        """It waits for its threshold, and can hold frames up to its limit."""
        return self.min_threshold_time, self.max_size_time or None

    def property_changed(self, name: str) -> None:
        """Limits and thresholds count at once: both sides look again."""
        thresholds = (self.min_threshold_buffers, self.min_threshold_bytes, self.min_threshold_time)
        self._levels.limit_bytes = self.max_size_bytes or sys.maxsize
        self._levels.limit_ns = self.max_size_time or sys.maxsize
        self._limit_buffers = self.max_size_buffers or sys.maxsize
        contended = self.leaky is Leaky.DOWNSTREAM or self.flush_on_eos  # upstream takes frames out too
        self._set(_thresholded=any(thresholds), _contended=contended)
        self._wake()

    # The upstream side.

    def query_caps(self, pad: Pad) -> Caps:
        """What the other side can carry."""
        return self.pads["sink" if pad.is_src else "src"].peer_caps()

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of the sink pad."""
        items, levels, append = self._items, self._levels, self._items.append

        def put(frame: Frame) -> None:
            if len(items) >= levels.alert:
                admitted = self._look(frame)
                if admitted is None:
                    return
                frame = admitted
            if (frame.data is not EMPTY or frame.pts is not None) and not self._weigh(frame):
                return
            append(frame)
            if self._downstream_sleeps:
                self._downstream_sleeps = False
                self._filled.set()

        return put

    def _look(self, frame: Frame) -> Frame | None:
        """Looks at what the length of the line asks for; the frame, or None where it was dropped."""
        levels = self._levels
        if len(self._items) >= levels.most:
            admitted = self._admit(frame)
            if admitted is None:
                return None
            frame = admitted
        if frame.data is EMPTY and frame.pts is None:  # others may still have to wait for bytes or time
            levels.rise()
        return frame

    def _admit(self, frame: Frame) -> Frame | None:
        """The frame if it may go in, perhaps after a wait; None where it was dropped."""
        if self._refusal is not None:
            raise self._refusal(self.name)
        if self._is_full() and not self._make_room():
            return None
        if self._tail_gap:
            self._set(_tail_gap=False)
            return frame.replace(flags=frame.flags | FrameFlags.DISCONTINUITY)
        return frame

    def _weigh(self, frame: Frame) -> bool:
        """Counts bytes and time, once there is room for them; False where the frame was dropped."""
        levels = self._levels
        is_full = levels.bytes >= levels.limit_bytes or levels.in_ns - levels.out_ns >= levels.limit_ns
        if is_full and self._is_full() and not self._make_room():
            return False
        levels.rise()
        levels.weigh_in(frame)
        if not self.care & WEIGHED:
            with self._lock:
                self.care |= WEIGHED
        return True

    def _is_full(self, taken: int = 0) -> bool:
        levels = self._levels
        return (
            levels.buffers + taken >= self._limit_buffers
            or levels.bytes >= levels.limit_bytes
            or levels.time_ns >= levels.limit_ns
        )

    def _make_room(self) -> bool:
        """Waits or drops as `leaky` says; False if the new frame is the one given up."""
        self._tell(self.on_overrun)
        if self.leaky is Leaky.UPSTREAM:
            self.count_drop("queue full, newest dropped")
            self._set(_tail_gap=True)
            return False
        while self._is_full():
            if self.leaky is not Leaky.DOWNSTREAM or not self._drop_oldest():
                self._wait_for_room()
        return True

    def _drop_oldest(self) -> bool:
        """Drops the oldest frame, never an event; False if the other side has just taken it."""
        oldest = next((item for item in tuple(self._items) if isinstance(item, Frame)), None)
        if oldest is None or not self._take_away(oldest):
            return False
        self._set(_head_gap=True)
        self.count_drop("queue full, oldest dropped")
        return True

    def _take_away(self, frame: Frame) -> bool:
        """Removes a frame in the upstream thread; False if the other side was quicker."""
        try:
            self._items.remove(frame)
        except (ValueError, IndexError):  # it is gone, or something was taken during the search
            return False
        self._levels.drop(frame)
        return True

    def _wait_for_room(self) -> None:
        self._upstream_sleeps_now(True)
        if self._is_full() and self._refusal is None and not self.stopping.is_set():
            self._room.wait(LOOK_S)
        if self._upstream_sleeps:
            self._upstream_sleeps_now(False)
        if self._refusal is not None:
            raise self._refusal(self.name)
        if self.stopping.is_set():
            raise Flushing(self.name)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Lines the event up behind the frames, without counting it; a flush overtakes them."""
        if isinstance(event, FlushStart):
            self.pads["src"].send_event(event)
            return
        if isinstance(event, FlushStop):
            self._finish_flush(event)
            return
        if self._refusal is not None and not self.is_flushing:
            return
        if isinstance(event, SegmentEvent):
            self._levels.in_offset_ns = event.segment.running_time_ns(0)
        elif isinstance(event, EosEvent) and self.flush_on_eos:
            held = [item for item in tuple(self._items) if isinstance(item, Frame)]
            self.count_drop("dropped at EOS", sum(self._take_away(frame) for frame in held))
        with self._lock:  # told before it is in the line: the chain behind takes out frames alone
            self._levels.in_events += 1
            self._heed()
        self._items.append(event)
        self._filled.set()

    def _may_read(self, taken: int = 0) -> bool:
        """Whether something may be handed on: past the thresholds, or full, or with an event at the tail."""
        if not self._thresholded:
            return bool(self._items) or taken > 0
        levels, tail = self._levels, next(reversed(tuple(self._items)), None)
        if tail is None and not taken:
            return False
        if self._is_full(taken) or not (tail is None or isinstance(tail, Frame)):
            return True
        return (
            levels.buffers + taken >= self.min_threshold_buffers
            and levels.bytes >= self.min_threshold_bytes
            and levels.time_ns >= self.min_threshold_time
        )
