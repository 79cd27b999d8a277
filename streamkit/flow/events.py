"""Events, segments, and the exceptions that unwind a streaming thread."""

from __future__ import annotations

from dataclasses import dataclass

from streamkit.flow.caps import Caps


@dataclass(frozen=True, slots=True)
class Segment:
    """A segment of a stream.

    Attributes:
        start_ns: first timestamp; frames wholly before it are not rendered.
        stop_ns: end timestamp; None is open.
        base_ns: running time at `start_ns`.

    Source: GStreamer's segment arithmetic, for playback at normal speed.
    """

    start_ns: int = 0
    stop_ns: int | None = None
    base_ns: int = 0

    def running_time_ns(self, pts_ns: int) -> int:
        """Running time of a timestamp, ns; less than `base_ns` before `start_ns`."""
        return pts_ns - self.start_ns + self.base_ns

    def holds(self, pts_ns: int, duration_ns: int | None) -> bool:
        """Whether a frame overlaps the segment."""
        if self.stop_ns is not None and pts_ns >= self.stop_ns:
            return False
        return pts_ns >= self.start_ns or pts_ns + (duration_ns or 0) > self.start_ns


OPEN_SEGMENT = Segment()


@dataclass(frozen=True, slots=True)
class CapsEvent:
    """The frames that follow have these caps."""

    caps: Caps


@dataclass(frozen=True, slots=True)
class SegmentEvent:
    """Maps the timestamps that follow to running time."""

    segment: Segment


@dataclass(frozen=True, slots=True)
class GapEvent:
    """No frame comes for a while; an element that waits for data takes the gap instead.

    Attributes:
        pts: start of the gap, ns; None if unknown.
        duration: ns; None if unknown.
    """

    pts: int | None
    duration: int | None = None


@dataclass(frozen=True, slots=True)
class DiscontinuityEvent:
    """The stream was interrupted: the frames that follow belong to a new epoch."""

    epoch: int
    reason: str = ""


@dataclass(frozen=True, slots=True)
class EosEvent:
    """No frame follows."""


@dataclass(frozen=True, slots=True)
class FlushEvent:
    """A flush begins or ends; it overtakes frames, in the sender's thread.

    Attributes:
        begins: whether held frames are to be dropped and new ones refused; at the end frames are accepted
            again, and nothing from before the flush remains.
    """

    begins: bool


Event = CapsEvent | SegmentEvent | GapEvent | DiscontinuityEvent | EosEvent | FlushEvent
EOS = EosEvent()
FLUSH_START, FLUSH_STOP = FlushEvent(begins=True), FlushEvent(begins=False)


class FlowStop(Exception):
    """Base of the reasons, none of them errors, why a push did not deliver its frame."""


class Flushing(FlowStop):
    """The pipeline is stopping."""


class EndOfStream(FlowStop):
    """Downstream wants no more frames."""


class NotLinked(FlowStop):
    """The pad has no peer."""
