"""input-selector: one of several streams."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from streamkit.element.branching import Combine
from streamkit.element.choice import Choice
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.elements.active_pad import demand_pad_name
from streamkit.flow.caps import ANY
from streamkit.flow.events import EOS, CapsEvent, EosEvent, Event, FlushStart, FlushStop, SegmentEvent
from streamkit.flow.frame import Frame
from streamkit.flow.signals import EndOfStream, Flushing

LOOK_S = 0.5
CLOCK_LOOK_S = 0.02
MOST_CACHED = 256


class SyncMode(Choice):
    """What inactive inputs keep step with."""

    ACTIVE_SEGMENT = "active-segment", 0, "Sync using the current active segment"
    CLOCK = "clock", 1, "Sync using the clock"


class InputSelector(Combine):
    """Passes on the frames of the active input and drops the others'; the first input is active at first.

    Example:
        input-selector name=s ! fakesink  fakesrc num-buffers=3 ! s.  fakesrc num-buffers=3 ! s.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    active_pad: str | None = Property(
        None, live=True, doc="Name of the input to pass on; unset is the first."
    )
    sync_streams: bool = Property(
        True, live=True, doc="Hold frames of inactive inputs until the active one has got as far in time."
    )
    sync_mode: SyncMode = Property(
        SyncMode.ACTIVE_SEGMENT, doc="With sync-streams: keep step with the active input or the clock."
    )
    cache_buffers: bool = Property(
        False, live=True, doc="Keep frames of inactive inputs that are not older than the active one's."
    )
    drop_backwards: bool = Property(
        False, live=True, doc="After a switch, drop frames older than the newest passed on."
    )
    n_pads: int = Property(0, read=lambda s: sum(1 for _ in s.sink_pads()), doc="Inputs now.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._moved = threading.Condition()
        self._time_ns: int | None = None
        self._made = 0
        self._cached: dict[str, deque[Frame]] = {}
        super().__init__(name, **properties)

    def start(self) -> None:
        """Nothing has been passed on."""
        self._time_ns = None
        self._cached = {}

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """An input; they are numbered in the order in which they are made, whatever number is asked for."""
        made = super().request_pad(template, f"sink_{self._made}")
        self._made += 1
        return made

    def _active(self) -> Pad | None:
        name = self.active_pad
        return next(self.sink_pads(), None) if name is None else self.pads.get(name)

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of a pad."""

        def receive(frame: Frame) -> None:
            if pad.is_eos:
                raise EndOfStream(self.name)
            if self.sync_streams and self._active() is not pad and frame.pts is not None:
                self._keep_step(pad, frame.pts + (frame.duration or 0))
            with self._lock:
                if self._active() is pad:
                    self._pass_on(pad, frame)
                elif self.cache_buffers:
                    self._cache(pad, frame)
                else:
                    self.count_drop("input not active")

        return receive

    def _keep_step(self, pad: Pad, end_ns: int) -> None:
        """Waits until the active input, or the clock, has got as far; or until this pad is the active one."""
        due_ns = pad.segment.running_time_ns(end_ns)
        with self._moved:
            while self.sync_streams and (active := self._active()) is not pad:
                if self.stopping.is_set() or self.is_flushing:
                    raise Flushing(self.name)
                if active is None or active.is_eos:
                    return
                by_clock = self.sync_mode is SyncMode.CLOCK
                now_ns = self.timing.running_time_ns() if by_clock else self._time_ns
                if now_ns is not None and now_ns > due_ns:
                    return
                with self.waiting():
                    self._moved.wait(CLOCK_LOOK_S if by_clock else LOOK_S)

    def _cache(self, pad: Pad, frame: Frame) -> None:
        kept = self._cached.setdefault(pad.name, deque())
        kept.append(frame)
        while kept and (len(kept) > MOST_CACHED or self._is_past(pad, kept[0])):
            kept.popleft()
            self.count_drop("input not active")

    def _is_past(self, pad: Pad, frame: Frame) -> bool:
        """Whether a frame ends before the newest that was passed on."""
        if frame.pts is None or self._time_ns is None:
            return False
        return pad.segment.running_time_ns(frame.pts + (frame.duration or 0)) < self._time_ns

    def _pass_on(self, pad: Pad, frame: Frame) -> None:
        for kept in self._cached.pop(pad.name, ()):
            if not self._is_past(pad, kept):
                self._push(kept, pad)
        if self.drop_backwards and self._is_past(pad, frame):
            self.count_drop("older than what was passed on")
            return
        self._push(frame, pad)
        if frame.pts is not None:
            with self._moved:
                self._time_ns = pad.segment.running_time_ns(frame.pts)
                self._moved.notify_all()

    def combine(self, pad_name: str, frame: Frame) -> Frame | None:
        """The frame, if it came in on the active pad."""
        active = self._active()
        return frame if active is not None and active.name == pad_name else None

    def receive_event(self, pad: Pad, event: Event) -> None:
        """EOS counts on the active input; caps and segments follow the frames; other active events go on."""
        if isinstance(event, FlushStart | FlushStop):
            self.src_pad.send_event(event)
            return
        with self._lock:
            if isinstance(event, EosEvent):
                pad.is_eos = True
                self._end_if_active_has()
            elif isinstance(event, SegmentEvent):
                if pad is self._source:
                    self.switched(pad)
            elif not isinstance(event, CapsEvent) and pad is self._active():
                self.src_pad.send_event(event)

    def _end_if_active_has(self) -> None:
        active = self._active()
        self._wake()
        if active is None or not active.is_eos or self._has_ended:
            return
        self._has_ended = True
        for kept in self._cached.pop(active.name, ()):
            self._push(kept, active)
        self.src_pad.send_event(EOS)

    def _end_if_all_have(self) -> None:
        self._end_if_active_has()

    def property_changed(self, name: str) -> None:
        """A change to an input that has ended ends the stream; who waits looks again."""
        if name == "active_pad":
            demand_pad_name(self, self.active_pad, "sink_%u")
        if self.is_playing:
            with self._lock:
                self._end_if_active_has()

    def flush(self, *, begins: bool) -> None:
        """A flush forgets times and frames kept, and ends waits."""
        super().flush(begins=begins)
        if not begins:
            self._time_ns = None
            self._cached = {}
        self._wake()

    def interrupt(self) -> None:
        """Wakes who waits."""
        self._wake()

    def stop(self) -> None:
        """Lets go of the frames kept."""
        self._cached = {}

    def _wake(self) -> None:
        with self._moved:
            self._moved.notify_all()
