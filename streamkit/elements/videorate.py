"""videorate: a steady frame rate, by dropping and repeating frames."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.transform import Transform
from streamkit.elements.framerate_caps import VARIABLE, guessed_rate, lowest_rate, rates_after, rates_before
from streamkit.errors import NotNegotiated, StreamError
from streamkit.flow.caps import Caps
from streamkit.flow.events import CapsEvent, DiscontinuityEvent, Event, FlushStart, FlushStop, SegmentEvent
from streamkit.flow.frame import Frame

SECOND_NS = 1_000_000_000
INT = 2**31 - 1
UINT64 = 2**64 - 1
KINDS = "video/x-raw(ANY); video/x-bayer(ANY); image/jpeg(ANY); image/png(ANY)"


class VideoRate(Transform):
    """Puts out a frame for each tick of the frame rate that follows: the one nearest to it in time.

    A frame is repeated where none came for a tick, and dropped where another was nearer.

    Example:
        videotestsrc num-buffers=5 ! videorate ! video/x-raw, framerate=10/1 ! fakesink
    """

    sink = src = KINDS

    drop_only: bool = Property(False, live=True, doc="Drop frames, repeat none; timestamps stay.")
    max_rate: int = Property(
        INT, min=1, max=INT, live=True, unit="frames/s", doc="Highest rate to let through; implies drop-only."
    )
    average_period: int = Property(
        0,
        min=0,
        max=2**63 - 1,
        unit="ns",
        doc="With max-rate: time to average the rate over; 0 is none.",
    )
    max_duplication_time: int = Property(
        0, min=0, max=UINT64, unit="ns", doc="Leave gaps longer than this unfilled; 0 is no limit."
    )
    max_closing_segment_duplication_duration: int = Property(
        SECOND_NS, min=0, max=UINT64, unit="ns", doc="Longest time filled at the end of a segment."
    )
    skip_to_first: bool = Property(False, doc="Put out nothing for the time before the first frame.")
    rate: float = Property(1.0, min=0.0, doc="Speed: times are divided by it.")
    silent: bool = Property(True, doc="Post no message for frames dropped and repeated.")
    frames_in: int = Property(0, name="in", read=lambda v: v._in, doc="Frames that came in.")
    out: int = Property(0, read=lambda v: v._out, doc="Frames put out.")
    drop: int = Property(0, read=lambda v: v._dropped, doc="Frames dropped.")
    duplicate: int = Property(0, read=lambda v: v._repeated, doc="Frames put out again.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._in = self._out = self._dropped = self._repeated = 0
        self._rate_out = VARIABLE
        self._rate_in = VARIABLE
        self._may_guess = False
        self._caps: Caps | None = None
        self._start_ns = 0
        self._forget()
        super().__init__(name, **properties)

    def _forget(self) -> None:
        """Begins anew with the next frame."""
        self._held: Frame | None = None
        self._held_ns = 0
        self._uses = 0
        self._base_ns: int | None = None
        self._ticks = 0
        self._last_ns: int | None = None
        self._average_ns = 0

    def start(self) -> None:
        """Begins to count."""
        self._in = self._out = self._dropped = self._repeated = 0
        self._start_ns = 0
        self._forget()

    def property_changed(self, name: str) -> None:
        """Other rates may be possible now."""
        if name in {"drop_only", "max_rate"} and self.is_playing:
            self.reconfigure()

    @property
    def _only_drops(self) -> bool:
        return self.drop_only or self.max_rate < INT

    # Negotiation.

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """Any frame rate from any other, the same one first."""
        change = rates_after if direction == "sink" else rates_before
        if caps.is_any:
            caps = Caps(KINDS)
        return change(caps, self.max_rate, drop_only=self.drop_only)

    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps | None:
        """The rate nearest to the one that comes in; a variable one stays until it can be guessed."""
        if sink_caps.get("framerate") is None:
            raise NotNegotiated(
                f"{self.name}: the caps {sink_caps} have no frame rate, which it needs; "
                "put framerate=0/1 for one that varies"
            )
        return allowed.fixate(near=sink_caps)

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """New caps: a frame that has not been put out yet goes first, with its own."""
        if self._caps is not None and src_caps != self._caps:
            self._push_unused()
            self._held = None
        self._caps = src_caps
        self._rate_in = lowest_rate(sink_caps["framerate"])
        rate = lowest_rate(src_caps["framerate"])
        if rate != self._rate_out and self._base_ns is not None:
            self._base_ns, self._ticks = self._tick_ns(), 0
        self._rate_out = rate
        self._may_guess = rate == 0 and not self._only_drops

    def _guess(self, interval_ns: int) -> None:
        """Settles on the rate that the first interval shows, if downstream takes it."""
        self._may_guess = False
        pad = self.src_pad
        held, self._held = self._held, None  # it has gone out already
        if interval_ns <= 0 or self._caps is None:
            return
        caps = self._caps.with_fields(framerate=guessed_rate(interval_ns))
        if (pad.peer_caps() & caps).is_empty:
            return
        self._configure(self.sink_caps, caps)
        pad.send_event(CapsEvent(caps))
        self._held, self._uses = held, 1
        self._base_ns, self._ticks, self._last_ns = self._held_ns, 1, None

    # Frames.

    def transform(self, frame: Frame) -> Iterable[Frame] | None:
        """The frames for the ticks that this frame decides."""
        self._in += 1
        if frame.pts is None:
            raise StreamError("the frame has no timestamp, so its place among the others is unknown")
        time_ns = self._relative_ns(frame.pts)
        if (self._held is not None and time_ns < self._held_ns) or self._is_behind(time_ns):
            self._drop("out of order")
            return None
        if self._may_guess and self._held is not None:
            self._guess(time_ns - self._held_ns)
        if self._base_ns is None:
            self._base_ns = time_ns if self.skip_to_first else 0
        if self._only_drops or self._rate_out == 0:
            return self._thinned(frame, time_ns)
        return self._for_ticks(frame, time_ns)

    def _is_behind(self, time_ns: int) -> bool:
        return self._last_ns is not None and time_ns < self._last_ns

    def _relative_ns(self, pts_ns: int) -> int:
        """Time since the segment's start, at the speed set."""
        since_ns = pts_ns - self._start_ns
        if self.rate == 1.0 or not self.rate:
            return since_ns
        stretched_ns = since_ns / self.rate
        if not math.isfinite(stretched_ns):
            raise StreamError(f"rate={self.rate:g} makes the time of the frame infinite; set one nearer to 1")
        return int(stretched_ns)

    def _tick_ns(self, ahead: int = 0) -> int:
        """Time of the next tick, or of one so many later."""
        if self._rate_out == 0:
            return self._last_ns or 0
        return (self._base_ns or 0) + int((self._ticks + ahead) * SECOND_NS / self._rate_out)

    def _for_ticks(self, frame: Frame, time_ns: int) -> Iterator[Frame]:
        """Frames for each tick up to this frame's time: the held one while it is nearer, then this one.

        They are made one by one, as a gap may take more of them than memory holds, until the pipeline stops.
        """
        if self._held is None:
            self._hold(frame, time_ns)
            return
        has_gap = bool(self.max_duplication_time) and time_ns - self._held_ns > self.max_duplication_time
        if has_gap:
            self._hold(frame, time_ns)
            self._base_ns, self._ticks = time_ns, 0
            yield self._put_out()
            self._ticks += 1  # GStreamer's count: the tick after the one at a gap's end is passed over
            return
        while self._held_nearer(time_ns) and not self.stopping.is_set():
            yield self._put_out()
        self._hold(frame, time_ns)
        while self._tick_ns() <= time_ns and not self.stopping.is_set():
            yield self._put_out()

    def _held_nearer(self, time_ns: int) -> bool:
        tick_ns = self._tick_ns()
        return abs(tick_ns - self._held_ns) < abs(time_ns - tick_ns)

    def _hold(self, frame: Frame, time_ns: int) -> None:
        if self._held is not None and not self._uses:
            self._drop("another is nearer to the tick")
        self._held, self._held_ns, self._uses = frame, time_ns, 0

    def _put_out(self) -> Frame:
        """The held frame, for the next tick."""
        assert self._held is not None
        start_ns, end_ns = self._tick_ns(), self._tick_ns(1)
        self._ticks += 1
        self._uses += 1
        if self._uses > 1:
            self._repeated += 1
            self._tell("duplicate", self._repeated)
        return self._numbered(self._held, start_ns, end_ns - start_ns)

    def _numbered(self, frame: Frame, time_ns: int, duration_ns: int | None) -> Frame:
        self._out += 1
        caps = self._caps if self._caps is not None else frame.caps
        pts = self._start_ns + time_ns
        return frame.replace(pts=pts, duration=duration_ns, seq=self._out - 1, caps=caps)

    def _thinned(self, frame: Frame, time_ns: int) -> Iterable[Frame] | None:
        """The frame, unless it comes too soon after the last one that was put out."""
        if self._is_too_soon(time_ns):
            self._drop("above the rate")
            return None
        self._last_ns = time_ns
        self._held_ns = time_ns
        if self._may_guess and self._held is None:
            self._held = frame
        duration = int(SECOND_NS / self._rate_out) if self._rate_out else frame.duration
        return [self._numbered(frame, time_ns, duration)]

    def _is_too_soon(self, time_ns: int) -> bool:
        if self.average_period and self.max_rate < INT:
            return self._is_above_average(time_ns)
        if self._rate_out == 0:
            return False
        half_ns = int(SECOND_NS / self._rate_in / 2) if self._rate_in > self._rate_out else 0
        if time_ns + half_ns < self._tick_ns():
            return True
        while self._tick_ns() <= time_ns + half_ns and not self.stopping.is_set():
            self._ticks += 1
        return False

    def _is_above_average(self, time_ns: int) -> bool:
        """Whether the averaged interval of the frames put out would fall below that of the highest rate."""
        if self._last_ns is None:
            return False
        step_ns = time_ns - self._last_ns
        rest_ns = max(0, self.average_period - step_ns)
        average_ns = (self._average_ns or step_ns) * rest_ns + step_ns * min(step_ns, self.average_period)
        average_ns //= self.average_period
        if average_ns < SECOND_NS // self.max_rate:
            return True
        self._average_ns = average_ns
        return False

    def _drop(self, reason: str) -> None:
        self._dropped += 1
        self.count_drop(reason)
        self._tell("drop", self._dropped)

    def _tell(self, what: str, count: int) -> None:
        if not self.silent:
            self.post_message(what, count=count)

    # Ends.

    def drain(self) -> Iterable[Frame]:
        """EOS: the held frame once more, and up to the segment's end where it has one."""
        if self._held is None or self._only_drops or self._rate_out == 0:
            return ()
        return self._closing()

    def _closing(self) -> Iterator[Frame]:
        segment = self.pads["sink"].segment
        repeated = self._repeated
        yield self._put_out()
        self._repeated = repeated
        if segment.stop_ns is None:
            return
        limit_ns = self._held_ns + self.max_closing_segment_duplication_duration
        stop_ns = min(self._relative_ns(segment.stop_ns), limit_ns)
        while self._tick_ns() < stop_ns and not self.stopping.is_set():
            yield self._put_out()

    def _push_unused(self) -> None:
        """Puts out a frame that no tick has had yet, before what follows it."""
        if self._held is not None and not self._uses and not self._only_drops and self._rate_out:
            self.src_pad.push(self._put_out())

    def event(self, event: Event) -> None:
        """A new segment or epoch begins anew, after the frame that is held."""
        if isinstance(event, SegmentEvent | DiscontinuityEvent | FlushStart | FlushStop):
            self._forget()
            self._start_ns = self.pads["sink"].segment.start_ns

    def pass_event(self, pad: Pad, event: Event) -> tuple[Pad, Event] | None:
        """Before a new segment or epoch the held frame goes out."""
        if isinstance(event, SegmentEvent | DiscontinuityEvent):
            self._push_unused()
        return super().pass_event(pad, event)
