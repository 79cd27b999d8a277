"""valve: lets frames through or not."""

from __future__ import annotations

import enum

from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.transform import Transform
from streamkit.flow.events import CapsEvent, Event
from streamkit.flow.frame import Frame, FrameFlags


class DropMode(enum.StrEnum):
    """What a closed valve holds back."""

    DROP_ALL = "drop-all"
    FORWARD_STICKY_EVENTS = "forward-sticky-events"


class Valve(Transform):
    """Drops every frame while `drop` is true; the first frame after it opens is marked as a discontinuity.

    Example:
        fakesrc num-buffers=10 ! valve drop=true drop-mode=forward-sticky-events ! fakesink
    """

    sink = src = "ANY"

    drop: bool = Property(False, live=True, doc="Let no frame through.")
    drop_mode: DropMode = Property(
        DropMode.DROP_ALL, doc="Hold back events too (drop-all), or let caps and EOS through."
    )

    def start(self) -> None:
        """Begins as if it had always been open."""
        self._was_closed = False
        self._held: Event | None = None

    def transform(self, frame: Frame) -> Frame | None:
        """The frame while open; the events held back go first."""
        if self.drop:
            self._was_closed = True
            self.count_drop("valve closed")
            return None
        if self._held is not None:
            held, self._held = self._held, None
            super().receive_event(self.pads["sink"], held)
        if self._was_closed:
            self._was_closed = False
            return frame.replace(flags=frame.flags | FrameFlags.DISCONTINUITY)
        return frame

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Passes events on; a closed valve keeps the latest caps for later and loses the rest."""
        if self.drop and self.drop_mode is DropMode.DROP_ALL:
            if isinstance(event, CapsEvent):
                self._held = event
            return
        super().receive_event(pad, event)
