"""fakesink: takes frames and forgets them."""

from __future__ import annotations

from typing import Any

from streamkit.element.choice import Choice
from streamkit.element.property import Property
from streamkit.elements.callbacks import Callbacks
from streamkit.elements.frame_text import dump_text, frame_text
from streamkit.elements.plainsink import PlainSink
from streamkit.errors import StateError
from streamkit.flow.frame import Frame
from streamkit.flow.signals import EndOfStream

INT = 2**31 - 1


class StateFault(Choice):
    """Which change of state is to fail."""

    NONE = "none", 0, "No state change errors"
    NULL_TO_READY = "null-to-ready", 1, "Fail state change from NULL to READY"
    READY_TO_PAUSED = "ready-to-paused", 2, "Fail state change from READY to PAUSED"
    PAUSED_TO_PLAYING = "paused-to-playing", 3, "Fail state change from PAUSED to PLAYING"
    PLAYING_TO_PAUSED = "playing-to-paused", 4, "Fail state change from PLAYING to PAUSED"
    PAUSED_TO_READY = "paused-to-ready", 5, "Fail state change from PAUSED to READY"
    READY_TO_NULL = "ready-to-null", 6, "Fail state change from READY to NULL"


GOING_DOWN = (StateFault.PLAYING_TO_PAUSED, StateFault.PAUSED_TO_READY, StateFault.READY_TO_NULL)


class FakeSink(PlainSink):
    """Takes every frame and does nothing with it; keeps the last one.

    Attributes:
        on_handoff: called with (frame, pad) for each frame, where `signal-handoffs` is on.
        on_preroll_handoff: the same for the frame that a paused pipeline holds.

    Example:
        fakesrc num-buffers=10 ! fakesink
    """

    sink = "ANY"

    num_buffers: int = Property(
        -1, min=-1, max=INT, doc="Frames before the sink ends the stream; -1 is never."
    )
    silent: bool = Property(True, live=True, doc="Post no message for each frame.")
    signal_handoffs: bool = Property(False, live=True, doc="Call `on_handoff` with each frame.")
    dump: bool = Property(False, live=True, doc="Post the bytes of each frame as a message.")
    drop_out_of_segment: bool = Property(True, doc="Drop frames that lie wholly outside the segment.")
    state_error: StateFault = Property(
        StateFault.NONE, doc="Fail at a change of state: at the start, or at the stop for those going down."
    )
    last_message: str | None = Property(None, readonly=True, doc="What was last done, unless silent.")
    can_activate_push: bool = Property(True, doc="Accepted, without effect: frames are always pushed.")
    can_activate_pull: bool = Property(False, doc="Accepted, without effect: frames are never pulled.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_handoff = Callbacks()
        self.on_preroll_handoff = Callbacks()
        self._is_plain = True
        super().__init__(name, **properties)

    def start(self) -> None:
        """Begins to count, or fails on purpose."""
        super().start()
        fault = self.state_error
        if fault is not StateFault.NONE and fault not in GOING_DOWN:
            raise StateError(f"state-error={fault}: the change of state at which to fail has come")

    def stop(self) -> None:
        """Ends, or fails on purpose."""
        super().stop()
        if self.state_error in GOING_DOWN:
            raise StateError(f"state-error={self.state_error}: the change of state at which to fail has come")

    def settle(self) -> None:
        """Looks whether each frame needs more than to be counted."""
        super().settle()
        self._is_plain = (
            self._keeps_last
            and not (self._has_ended or self.signal_handoffs or self.dump)
            and self._clip is None
            and self.silent
            and self.num_buffers < 0
        )

    def preroll(self, frame: Frame | None) -> None:
        """The frame that a paused pipeline holds."""
        if frame is not None and self.signal_handoffs:
            self.on_preroll_handoff.emit(frame, self.pads["sink"])

    def render(self, frame: Frame) -> None:
        """Counts the frame."""
        if self._is_plain:
            self.count += 1
            self.last_frame = frame
        else:
            self._render_fully(frame)

    def _render_fully(self, frame: Frame) -> None:
        self.demand_open()
        limit = self.num_buffers
        if 0 <= limit <= self.count:
            raise EndOfStream(self.name)
        if self.drop_out_of_segment and self.is_outside(frame):
            return
        self.count += 1
        if self._keeps_last:
            self.last_frame = frame
        if not self.silent:
            self.last_message = frame_text("chain", self.pads["sink"], frame)
            self.post_message("frame", seq=frame.seq, pts=frame.pts, caps=str(frame.caps))
        if self.dump:
            self.post_message("dump", content=dump_text(frame))
        if self.signal_handoffs:
            self.on_handoff.emit(frame, self.pads["sink"])
        if self.count == limit:
            raise EndOfStream(self.name)
