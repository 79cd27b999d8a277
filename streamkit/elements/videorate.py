"""videorate: a constant frame rate, by dropping and duplicating frames."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from typing_extensions import override

from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.property_text import INT, INT64, UINT64
from streamkit.element.transform import Transform
from streamkit.elements.framerate_caps import VARIABLE, estimated_rate, rate_bounds, rates_after, rates_before
from streamkit.errors import NotNegotiated, StreamError
from streamkit.flow.caps import Caps
from streamkit.flow.clock import SECOND_NS
from streamkit.flow.events import CapsEvent, DiscontinuityEvent, Event, FlushEvent, SegmentEvent
from streamkit.flow.frame import Frame

KINDS = "video/x-raw(ANY); video/x-bayer(ANY); image/jpeg(ANY); image/png(ANY)"


@dataclass
class HeldFrame:
    """A frame that is sent for each tick that it is nearest to."""

    frame: Frame
    time_ns: int  # since the segment's start
    uses: int = 0  # how often it was sent


class VideoRate(Transform):
    """Sends a frame for each tick of the output frame rate: the one nearest in time.

    A frame is duplicated if none arrived for a tick, and dropped if another one is nearer.

    Example:
        videotestsrc num-buffers=5 ! videorate ! video/x-raw, framerate=10/1 ! fakesink
    """

    sink = src = KINDS

    drop_only: bool = Property(False, live=True, doc="Only drop frames, without changing timestamps.")
    max_rate: int = Property(
        INT, min=1, max=INT, live=True, unit="frames/s", doc="Maximum output rate; implies drop-only."
    )
    average_period: int = Property(
        0, min=0, max=INT64, unit="ns", doc="With max-rate: averaging period of the rate; 0 is none."
    )
    max_duplication_time: int = Property(0, min=0, max=UINT64, unit="ns", doc="Longest filled gap; 0 is any.")
    max_closing_segment_duplication_duration: int = Property(
        SECOND_NS, min=0, max=UINT64, unit="ns", doc="Maximum time filled at the end of a segment."
    )
    skip_to_first: bool = Property(False, doc="Send nothing for the time before the first frame.")
    rate: float = Property(1.0, min=0.0, doc="Speed: timestamps are divided by it.")
    silent: bool = Property(True, doc="Post no message for dropped and duplicated frames.")
    frames_in: int = Property(0, name="in", read=lambda v: v._in, doc="Frames received.")
    out: int = Property(0, read=lambda v: v._out, doc="Frames sent.")
    drop: int = Property(0, read=lambda v: v._dropped, doc="Frames dropped.")
    duplicate: int = Property(0, read=lambda v: v._repeated, doc="Frames duplicated.")

    _rate_in = _rate_out = VARIABLE
    _may_estimate = False
    _caps: Caps | None = None

    def _forget(self) -> None:
        """Starts again with the next frame."""
        self._held: HeldFrame | None = None
        self._base_ns: int | None = None
        self._ticks = 0
        self._last_ns: int | None = None
        self._average_ns = 0

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._in = self._out = self._dropped = self._repeated = 0
        self._start_ns = 0
        self._forget()

    def property_changed(self, name: str) -> None:
        """Renegotiates, as other rates may be possible."""
        if name in {"drop_only", "max_rate"} and self.is_playing:
            self.reconfigure()

    @property
    def _only_drops(self) -> bool:
        return self.drop_only or self.max_rate < INT

    @property
    def _has_ticks(self) -> bool:
        return not self._only_drops and self._rate_out > 0

    # Negotiation.

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """Any frame rate, the same one first."""
        change = rates_after if direction == "sink" else rates_before
        if caps.is_any:
            caps = Caps(KINDS)
        return change(caps, self.max_rate, drop_only=self.drop_only)

    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps | None:
        """The rate nearest to the input's; a variable rate stays until it is estimated."""
        if sink_caps.get("framerate") is None:
            raise NotNegotiated(
                f"{self.name}: the caps {sink_caps} have no frame rate, which it needs; "
                "put framerate=0/1 for one that varies"
            )
        return allowed.fixate(near=sink_caps)

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """New caps; an unused held frame is sent first, with its own caps."""
        if self._caps is not None and src_caps != self._caps:
            self._push_unused()
            self._held = None
        self._caps = src_caps
        self._rate_in = rate_bounds(sink_caps["framerate"])[0]
        rate = rate_bounds(src_caps["framerate"])[0]
        if rate != self._rate_out and self._base_ns is not None:
            self._base_ns, self._ticks = self._tick_ns(), 0
        self._rate_out = rate
        self._may_estimate = rate == 0 and not self._only_drops

    def _estimate_rate(self, interval_ns: int) -> None:
        """Estimates a variable rate from the first interval, if downstream accepts it."""
        self._may_estimate = False
        pad = self.src_pad
        held, self._held = self._held, None  # already sent
        assert held is not None
        if interval_ns <= 0 or self._caps is None:
            return
        caps = self._caps.with_fields(framerate=estimated_rate(interval_ns))
        if not caps.can_intersect(pad.peer_caps()):
            return
        self._configure(self.sink_caps, caps)
        pad.send_event(CapsEvent(caps))
        self._held, held.uses = held, 1
        self._base_ns, self._ticks, self._last_ns = held.time_ns, 1, None

    # Frames.

    def transform(self, frame: Frame) -> Iterable[Frame] | None:
        """The frames for the ticks up to this frame."""
        self._in += 1
        if frame.pts is None:
            raise StreamError("the frame has no timestamp, so its place among the others is unknown")
        time_ns = self._relative_ns(frame.pts)
        is_behind = self._last_ns is not None and time_ns < self._last_ns
        if is_behind or (self._held is not None and time_ns < self._held.time_ns):
            self._drop("out of order")
            return None
        if self._may_estimate and self._held is not None:
            self._estimate_rate(time_ns - self._held.time_ns)
        if self._base_ns is None:
            self._base_ns = time_ns if self.skip_to_first else 0
        return self._for_ticks(frame, time_ns) if self._has_ticks else self._decimated(frame, time_ns)

    def _relative_ns(self, pts_ns: int) -> int:
        """Time since the segment's start, divided by `rate`."""
        since_ns = pts_ns - self._start_ns
        if self.rate == 1.0 or not self.rate:
            return since_ns
        stretched_ns = since_ns / self.rate
        if not math.isfinite(stretched_ns):
            raise StreamError(f"rate={self.rate:g} makes the time of the frame infinite; set one nearer to 1")
        return int(stretched_ns)

    def _tick_ns(self, ahead: int = 0) -> int:
        """Time of the next tick, or of a later one."""
        if self._rate_out == 0:
            return self._last_ns or 0
        return (self._base_ns or 0) + int((self._ticks + ahead) * SECOND_NS / self._rate_out)

    def _for_ticks(self, frame: Frame, time_ns: int) -> Iterator[Frame]:
        """Yields the held frame for each tick it is nearest to, then this one; lazily: gaps may be long."""
        held = self._held
        if held is None:
            self._hold(frame, time_ns)
            return
        if 0 < self.max_duplication_time < time_ns - held.time_ns:
            self._hold(frame, time_ns)
            self._base_ns, self._ticks = time_ns, 0
            yield self._emit()
            self._ticks += 1  # as GStreamer: skips the tick after the end of a gap
            return
        while self._is_nearer(held, time_ns) and not self.stopping.is_set():
            yield self._emit()
        self._hold(frame, time_ns)
        while self._tick_ns() <= time_ns and not self.stopping.is_set():
            yield self._emit()

    def _is_nearer(self, held: HeldFrame, time_ns: int) -> bool:
        """Whether the held frame is nearer to the next tick than one of the given time."""
        tick_ns = self._tick_ns()
        return abs(tick_ns - held.time_ns) < abs(time_ns - tick_ns)

    def _hold(self, frame: Frame, time_ns: int) -> None:
        if self._held is not None and not self._held.uses:
            self._drop("another is nearer to the tick")
        self._held = HeldFrame(frame, time_ns)

    def _emit(self, *, counts_repeat: bool = True) -> Frame:
        """Returns the held frame with the timestamp of the next tick; counts it if it was used before."""
        held = self._held
        assert held is not None
        start_ns, end_ns = self._tick_ns(), self._tick_ns(1)
        self._ticks += 1
        held.uses += 1
        if counts_repeat and held.uses > 1:
            self._repeated += 1
            self._post_count("duplicate", self._repeated)
        return self._numbered(held.frame, start_ns, end_ns - start_ns)

    def _numbered(self, frame: Frame, time_ns: int, duration_ns: int | None) -> Frame:
        self._out += 1
        caps = self._caps if self._caps is not None else frame.caps
        pts = self._start_ns + time_ns
        return frame.replace(pts=pts, duration=duration_ns, seq=self._out - 1, caps=caps)

    def _decimated(self, frame: Frame, time_ns: int) -> Iterable[Frame] | None:
        """The frame, unless it is too soon after the previous output."""
        if not self._take_tick(time_ns):
            self._drop("above the rate")
            return None
        self._last_ns = time_ns
        if self._may_estimate and self._held is None:
            self._held = HeldFrame(frame, time_ns)
        duration = int(SECOND_NS / self._rate_out) if self._rate_out else frame.duration
        return [self._numbered(frame, time_ns, duration)]

    def _take_tick(self, time_ns: int) -> bool:
        """Takes the next tick for a frame; False if the frame comes too soon for it."""
        if self.average_period and self.max_rate < INT:
            return self._update_average(time_ns)
        if self._rate_out == 0:
            return True
        half_ns = int(SECOND_NS / self._rate_in / 2) if self._rate_in > self._rate_out else 0
        if time_ns + half_ns < self._tick_ns():
            return False
        while self._tick_ns() <= time_ns + half_ns and not self.stopping.is_set():
            self._ticks += 1
        return True

    def _update_average(self, time_ns: int) -> bool:
        """Adds a frame to the average output interval; False if that fell below the one of `max-rate`."""
        if self._last_ns is None:
            return True
        step_ns = time_ns - self._last_ns
        rest_ns = max(0, self.average_period - step_ns)
        average_ns = (self._average_ns or step_ns) * rest_ns + step_ns * min(step_ns, self.average_period)
        average_ns //= self.average_period
        if average_ns < SECOND_NS // self.max_rate:
            return False
        self._average_ns = average_ns
        return True

    def _drop(self, reason: str) -> None:
        self._dropped += 1
        self.count_drop(reason)
        self._post_count("drop", self._dropped)

    def _post_count(self, what: str, count: int) -> None:
        if not self.silent:
            self.post_message(what, count=count)

    # Ends.

    def drain(self) -> Iterable[Frame]:
        """Sends the held frame at EOS, repeated up to the end of the segment, else of the frame itself."""
        return self._closing(self._held) if self._held is not None and self._has_ticks else ()

    def _closing(self, held: HeldFrame) -> Iterator[Frame]:
        segment, duration_ns = self.pads["sink"].segment, held.frame.duration
        if segment.stop_ns is None and duration_ns is not None and held.uses:
            yield from self._filling(held.time_ns + int(duration_ns / (self.rate or 1.0)))
            return
        yield self._emit(counts_repeat=False)  # the end of the stream, as GStreamer counts it
        if segment.stop_ns is None:
            return
        limit_ns = held.time_ns + self.max_closing_segment_duplication_duration
        stop_ns = min(self._relative_ns(segment.stop_ns), limit_ns)
        while self._tick_ns() < stop_ns and not self.stopping.is_set():
            yield self._emit()

    def _filling(self, end_ns: int) -> Iterator[Frame]:
        """The held frame for each tick of which at least half lies before a time."""
        while (self._tick_ns() + self._tick_ns(1)) / 2 <= end_ns and not self.stopping.is_set():
            yield self._emit()

    def _push_unused(self) -> None:
        """Sends a held frame that no tick has used yet."""
        if self._held is not None and not self._held.uses and self._has_ticks:
            self.src_pad.push(self._emit())

    def event(self, event: Event) -> None:
        """Starts again at a new segment or epoch, or a flush."""
        if isinstance(event, SegmentEvent | DiscontinuityEvent | FlushEvent):
            self._forget()
            self._start_ns = self.pads["sink"].segment.start_ns

    def receive_event(self, pad: Pad, event: Event) -> tuple[Pad, Event] | None:
        """Sends the held frame before a new segment or epoch."""
        if isinstance(event, SegmentEvent | DiscontinuityEvent):
            self._push_unused()
        return super().receive_event(pad, event)
