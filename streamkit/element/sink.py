"""Sink: an element at the end of a stream."""

from __future__ import annotations

from collections.abc import Callable

from typing_extensions import override

from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.property_text import INT64, UINT64, Choice
from streamkit.flow.caps import Caps
from streamkit.flow.events import CapsEvent, EosEvent, Event, Flushing, GapEvent
from streamkit.flow.frame import Frame


class OnError(Choice):
    """Consequence of a failure in a branch behind a tee."""

    END = "end", 0, "The pipeline ends"
    DROP_BRANCH = "drop-branch", 1, "The branch is dropped, the others go on"


class Sink(Element):
    """Base class of sinks: override `render`, and `drain` to finish at EOS.

    In a paused pipeline a sink holds the first frame that arrives: it has prerolled.

    Attributes:
        position_ns: timestamp of the last frame rendered with `sync` or `throttle-time`, or None.
    """

    sync: bool = Property(False, doc="Render each frame at its running time.")
    wait_for_preroll: bool = Property(
        True, name="async", doc="Whether a paused pipeline is prerolled only when this sink holds a frame."
    )
    max_lateness: int = Property(
        -1, min=-1, max=INT64, unit="ns", doc="With sync: drop frames later than this; -1 is never."
    )
    qos: bool = Property(False, doc="With sync: post a message for each frame dropped because it is late.")
    ts_offset: int = Property(0, min=-INT64, max=INT64, unit="ns", doc="With sync: delay of each frame.")
    render_delay: int = Property(
        0, min=0, max=UINT64, unit="ns", doc="With sync: render each frame this much earlier."
    )
    throttle_time: int = Property(0, min=0, max=UINT64, unit="ns", doc="Minimum frame interval.")
    processing_deadline: int = Property(
        20_000_000, min=0, max=UINT64, unit="ns", doc="With sync: time to process live frames."
    )

    on_error: OnError = Property(
        OnError.END, doc="Behind a tee: whether a failure ends the pipeline or only this branch."
    )

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._has_prerolled = False
        self._last_end_ns = self._next_ns = 0
        self.position_ns: int | None = None

    # Overridden by authors.

    def render(self, frame: Frame) -> None:
        """Consumes one frame."""
        raise NotImplementedError(f"{type(self).__name__} does not define render")

    def preroll(self, frame: Frame | None) -> None:
        """Shows the first frame while the pipeline is paused; it is rendered later. None for a gap or EOS."""

    def drain(self) -> None:
        """Finishes all work at EOS."""

    def configure(self, sink_caps: Caps) -> None:
        """New caps for the frames that follow."""

    # Called by the engine.

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function called with each frame, for the current state and properties."""
        is_timed = self.sync or self.throttle_time > 0
        if self.timing.running.is_set() and not is_timed:
            return self.render

        def receive(frame: Frame) -> None:
            if self.clip(frame, pad):
                return
            if not self.timing.running.is_set():
                self._hold(frame)
            if is_timed and frame.pts is not None:
                self._render_in_time(frame, pad.segment.running_time_ns(frame.pts))
            else:
                self.render(frame)

        return receive

    def clip(self, frame: Frame, pad: Pad) -> bool:
        """Drops and counts a frame that is outside the pad's segment; whether it did."""
        if frame.pts is None or pad.segment.holds(frame.pts, frame.duration):
            return False
        self.count_drop("outside the segment")
        self.warn_once(
            f"a frame at {frame.pts / 1e9:.3f} s is outside the stream, which begins at "
            f"{pad.segment.start_ns / 1e9:.3f} s, and is dropped, as is each further one; "
            "give frames times that ascend",
            code="segment",
        )
        return True

    def _render_in_time(self, frame: Frame, running_time_ns: int) -> None:
        if self.throttle_time:
            if running_time_ns < self._next_ns:
                self.count_drop("throttled")
                return
            self._next_ns = running_time_ns + self.throttle_time
        if not self.sync or self._wait_for_time(frame, running_time_ns):
            self.position_ns = frame.pts
            self._last_end_ns = running_time_ns + (frame.duration or 0)
            self.render(frame)

    def _wait_for_time(self, frame: Frame, running_time_ns: int) -> bool:
        """Waits until a frame is due, across pauses; False if it is too late."""
        flushes, delay_ns = self.flushes, self.ts_offset - self.render_delay
        while not self.wait_on_clock(self.timing.due_ns(running_time_ns) + delay_ns):
            if self.must_give_up(flushes):
                raise Flushing(self.name)
            self._hold(frame)
        late_ns = self.clock_ns() - self.timing.due_ns(running_time_ns) - delay_ns
        if self.max_lateness < 0 or late_ns <= self.max_lateness:
            return True
        self.count_drop("too late")
        if self.qos:
            self.post_message("qos", pts=frame.pts, late_ns=late_ns, dropped=self.drops["too late"])
        return False

    def _hold(self, frame: Frame | None) -> None:
        """Prerolls, once per pause, and waits until the pipeline plays."""
        if self.timing.running.is_set():
            return
        flushes = self.flushes  # one that begins while the frame is shown drops it, too
        if not self._has_prerolled:
            self._has_prerolled = True
            self.preroll(frame)
            self.host.prerolled(self)
        plays = self.wait_while_paused(flushes)
        self._has_prerolled = False
        if not plays:
            raise Flushing(self.name)

    def flush(self, *, begins: bool) -> None:
        """Begins or ends a flush, which drops the held frame."""
        super().flush(begins=begins)
        self._has_prerolled = False
        self.position_ns = None

    def latency(self) -> tuple[int, int | None]:
        """With `sync`, the processing deadline and the render delay."""
        return (self.processing_deadline + self.render_delay if self.sync else 0), 0

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Handles caps, gaps and EOS; reports EOS once everything is drained."""
        with self.guarded():
            if isinstance(event, CapsEvent):
                accepted = pad.template.caps & self.query_caps(pad)
                if not event.caps.can_intersect(accepted) and pad.peer is not None:
                    raise pad.peer.refusal(event.caps, accepted)
                self.configure(event.caps)
            elif isinstance(event, GapEvent):
                self._hold(None)
            elif isinstance(event, EosEvent) and not pad.is_eos:
                self._end(pad)

    def _end(self, pad: Pad) -> None:
        """Waits for the end of the last frame rendered, and for a paused pipeline to play, then drains."""
        self._hold(None)
        if self.sync and self._last_end_ns and not self.wait_until_due(self._last_end_ns, self.ts_offset):
            raise Flushing(self.name)
        linked = [other for other in self.sink_pads() if other is not pad and other.peer is not None]
        is_last = all(other.is_eos for other in linked)
        if is_last and not self.has_failed:
            with self.calling("drain"):
                self.drain()
        pad.is_eos = True
        if is_last:
            self.host.sink_ended(self)
