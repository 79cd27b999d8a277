"""input-selector: forwards one of several streams."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from typing_extensions import override

from streamkit.element.branching import Combine, check_active_pad
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.element.property_text import Choice
from streamkit.flow.caps import ANY
from streamkit.flow.events import EOS, EndOfStream, Event
from streamkit.flow.frame import Frame
from streamkit.handoff.bounded_queue import POLL_S

CLOCK_POLL_S = 0.02
MAX_CACHED = 256


class SyncMode(Choice):
    """What inactive inputs are synchronised to."""

    ACTIVE_SEGMENT = "active-segment", 0, "Sync using the current active segment"
    CLOCK = "clock", 1, "Sync using the clock"


class InputSelector(Combine):
    """Forwards the frames of the active input, initially the first, and drops all others.

    Example:
        input-selector name=s ! fakesink  fakesrc num-buffers=3 ! s.  fakesrc num-buffers=3 ! s.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    active_pad: str | None = Property(None, live=True, doc="Name of the active input; unset is the first.")
    sync_streams: bool = Property(True, live=True, doc="Make inactive inputs wait for the active one.")
    sync_mode: SyncMode = Property(
        SyncMode.ACTIVE_SEGMENT, doc="With sync-streams: synchronise to the active input or the clock."
    )
    cache_buffers: bool = Property(
        False, live=True, doc="Keep frames of inactive inputs unless they are older than the active one's."
    )
    drop_backwards: bool = Property(False, live=True, doc="After a switch, drop frames older than the last.")
    n_pads: int = Property(0, read=lambda s: sum(1 for _ in s.sink_pads()), doc="Number of inputs.")

    _made = 0  # inputs so far

    @override
    def start(self) -> None:
        check_active_pad(self, self.active_pad, "sink_%u")  # every input is known now

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._time_ns: int | None = None
        self._cached: dict[str, deque[Frame]] = {}

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Adds an input; inputs are numbered in order, whatever number is requested."""
        made = super().request_pad(template, f"sink_{self._made}")
        self._made += 1
        return made

    def _active(self) -> Pad | None:
        name = self.active_pad
        return next(self.sink_pads(), None) if name is None else self.pads.get(name)

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        def receive(frame: Frame) -> None:
            if pad.is_eos:
                raise EndOfStream(self.name)
            if self.sync_streams and self._active() is not pad and frame.pts is not None:
                self._synchronise(pad, frame.pts + (frame.duration or 0))
            with self.combine_lock:
                if self._active() is pad:
                    self._forward_frame(pad, frame)
                elif self.cache_buffers:
                    self._cache(pad, frame)
                else:
                    self.count_drop("input not active")

        return receive

    def _synchronise(self, pad: Pad, end_ns: int) -> None:
        """Waits until the active input or the clock reaches a time, or until this pad is active."""
        due_ns = pad.segment.running_time_ns(end_ns)
        by_clock = self.sync_mode is SyncMode.CLOCK

        def is_reached() -> bool:
            active = self._active()
            if not self.sync_streams or active is None or active is pad or active.is_eos:
                return True
            now_ns = self.timing.running_time_ns() if by_clock else self._time_ns
            return now_ns is not None and now_ns > due_ns

        with self.changed:
            self.wait_for(is_reached, CLOCK_POLL_S if by_clock else POLL_S)

    def _cache(self, pad: Pad, frame: Frame) -> None:
        kept = self._cached.setdefault(pad.name, deque())
        kept.append(frame)
        while kept and (len(kept) > MAX_CACHED or self._is_past(pad, kept[0])):
            kept.popleft()
            self.count_drop("input not active")

    def _is_past(self, pad: Pad, frame: Frame) -> bool:
        """Whether a frame ends before the newest one forwarded."""
        if frame.pts is None or self._time_ns is None:
            return False
        return pad.segment.running_time_ns(frame.pts + (frame.duration or 0)) < self._time_ns

    def _forward_frame(self, pad: Pad, frame: Frame) -> None:
        for kept in self._cached.pop(pad.name, ()):
            if not self._is_past(pad, kept):
                self.push_output(kept, pad)
        if self.drop_backwards and self._is_past(pad, frame):
            self.count_drop("older than what was passed on")
            return
        self.push_output(frame, pad)
        if frame.pts is not None:
            with self.changed:
                self._time_ns = pad.segment.running_time_ns(frame.pts)
                self.changed.notify_all()

    def _forward_event(self, pad: Pad, event: Event) -> None:
        if pad is self._active():
            self.src_pad.send_event(event)

    def _send_eos_if_all_ended(self) -> None:
        active = self._active()
        self.wake()
        if active is None or not active.is_eos or self.src_pad.is_eos:
            return
        for kept in self._cached.pop(active.name, ()):
            self.push_output(kept, active)
        self.src_pad.send_event(EOS)

    def property_changed(self, name: str) -> None:
        """Wakes waiting inputs; ends the stream if the new active input has ended."""
        if name == "active_pad":
            check_active_pad(self, self.active_pad, "sink_%u")
        if self.is_playing:
            with self.combine_lock:
                self._send_eos_if_all_ended()

    def flush(self, *, begins: bool) -> None:
        """A flush forgets times and cached frames, and ends waits."""
        super().flush(begins=begins)
        if not begins:
            self._time_ns = None
            self._cached = {}
        self.wake()

    @override
    def stop(self) -> None:
        self._cached = {}
