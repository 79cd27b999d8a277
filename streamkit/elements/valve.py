"""valve: forwards or drops frames."""

from __future__ import annotations

from typing_extensions import override

from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.property_text import Choice
from streamkit.element.transform import Transform
from streamkit.flow.events import CapsEvent, Event, FlushEvent, GapEvent, SegmentEvent
from streamkit.flow.frame import Frame, FrameFlags


class DropMode(Choice):
    """What a closed valve drops."""

    DROP_ALL = "drop-all", 0, "Drop all buffers and events"
    FORWARD_STICKY_EVENTS = "forward-sticky-events", 1, "Drop all buffers but forward sticky events"
    TRANSFORM_TO_GAP = (
        "transform-to-gap", 2, "Convert all dropped buffers into gap events and forward sticky events",
    )  # fmt: skip


class Valve(Transform):
    """Drops every frame while `drop` is true; the first frame after that is flagged as a discontinuity.

    Example:
        fakesrc num-buffers=10 ! valve drop=true drop-mode=forward-sticky-events ! fakesink
    """

    sink = src = "ANY"

    drop: bool = Property(False, live=True, doc="Drop all frames.")
    drop_mode: DropMode = Property(DropMode.DROP_ALL, doc="Drop events too, only frames, or send gaps.")

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._was_closed = False
        self._held: dict[type, Event] = {}

    def transform(self, frame: Frame) -> Frame | None:
        """Returns the frame while open, after sending the events held back."""
        if self.drop:
            self._was_closed = True
            self.count_drop("valve closed")
            if self.drop_mode is DropMode.TRANSFORM_TO_GAP:
                self.src_pad.send_event(GapEvent(frame.pts, frame.duration))
            return None
        if self._was_closed:
            self._was_closed = False
            for kind in (CapsEvent, SegmentEvent):
                if kind in self._held:
                    self.pads["sink"].receive_event(self._held.pop(kind))
            return frame.replace(caps=self.src_caps, flags=frame.flags | FrameFlags.DISCONTINUITY)
        return frame

    def receive_event(self, pad: Pad, event: Event) -> tuple[Pad, Event] | None:
        """Forwards events; with `drop-all` a closed valve drops all but the latest caps and segment."""
        is_flush = isinstance(event, FlushEvent)
        if self.drop and self.drop_mode is DropMode.DROP_ALL and not is_flush:
            self._was_closed = True
            if isinstance(event, CapsEvent | SegmentEvent):
                self._held[type(event)] = event
            return None
        return super().receive_event(pad, event)
