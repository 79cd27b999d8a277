"""valve: lets frames through or not."""

from __future__ import annotations

from typing import Any

from streamkit.element.choice import Choice
from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.transform import Transform
from streamkit.flow.events import CapsEvent, Event, FlushStart, FlushStop, GapEvent, SegmentEvent
from streamkit.flow.frame import Frame, FrameFlags


class DropMode(Choice):
    """What a closed valve holds back."""

    DROP_ALL = "drop-all", 0, "Drop all buffers and events"
    FORWARD_STICKY_EVENTS = "forward-sticky-events", 1, "Drop all buffers but forward sticky events"
    TRANSFORM_TO_GAP = (
        "transform-to-gap",
        2,
        "Convert all dropped buffers into gap events and forward sticky events",
    )


class Valve(Transform):
    """Drops every frame while `drop` is true; the first frame after it opens is marked as a discontinuity.

    Example:
        fakesrc num-buffers=10 ! valve drop=true drop-mode=forward-sticky-events ! fakesink
    """

    sink = src = "ANY"

    drop: bool = Property(False, live=True, doc="Let no frame through.")
    drop_mode: DropMode = Property(
        DropMode.DROP_ALL,
        doc="Hold back events too, hold back frames only, or turn frames into gaps.",
    )

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._is_closed = self._was_closed = False
        self._held: dict[type, Event] = {}
        super().__init__(name, **properties)

    def start(self) -> None:
        """Begins as if it had always been open."""
        self._was_closed = False
        self._held = {}

    def property_changed(self, name: str) -> None:
        """Opens or closes from the next frame on."""
        self._is_closed = self.drop

    def transform(self, frame: Frame) -> Frame | None:
        """The frame while open; the events held back go first."""
        if self._is_closed:
            self._was_closed = True
            self.count_drop("valve closed")
            if self.drop_mode is DropMode.TRANSFORM_TO_GAP:
                self.src_pad.send_event(GapEvent(frame.pts, frame.duration))
            return None
        if self._was_closed:
            self._was_closed = False
            for kind in (CapsEvent, SegmentEvent):
                if kind in self._held:
                    super().receive_event(self.pads["sink"], self._held.pop(kind))
            return frame.replace(caps=self.src_caps, flags=frame.flags | FrameFlags.DISCONTINUITY)
        return frame

    def pass_event(self, pad: Pad, event: Event) -> tuple[Pad, Event] | None:
        """Passes events on; one closed to all keeps the latest caps and segment and loses the rest."""
        is_flush = isinstance(event, FlushStart | FlushStop)
        if self._is_closed and self.drop_mode is DropMode.DROP_ALL and not is_flush:
            self._was_closed = True
            if isinstance(event, CapsEvent | SegmentEvent):
                self._held[type(event)] = event
            return None
        return super().pass_event(pad, event)
