"""fakesink: discards frames; and what it shares with appsink."""

from __future__ import annotations

from typing import Any

from typing_extensions import override

from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.property_text import INT, UINT, Choice
from streamkit.element.sink import Sink
from streamkit.elements.frame_report import Callbacks, report_frame
from streamkit.errors import StateError
from streamkit.flow.events import EndOfStream
from streamkit.flow.frame import Frame


class PlainSink(Sink):
    """State and checks that fakesink and appsink share: counters, the last frame, EOS.

    `render` of a subclass calls `check_open`, `clip` and `note`.

    Attributes:
        count: frames rendered since the start.
        last_frame: the newest frame, or None if `enable_last_sample` is off.
    """

    enable_last_sample: bool = Property(True, live=True, doc="Keep the last frame in `last_frame`.")
    blocksize: int = Property(4096, min=0, max=UINT, doc="Accepted, without effect: frames are never pulled.")
    stats: str = Property("", read=lambda sink: sink._stats(), doc="Frames rendered and dropped.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.count = 0
        self.last_frame: Frame | None = None
        self._has_ended = False
        super().__init__(name, **properties)

    def _stats(self) -> str:
        dropped = sum(self.drops.values())
        return f"application/x-sink-stats, rendered={self.count}, dropped={dropped}"

    @override
    def start(self) -> None:
        self.count = 0
        self.last_frame = None
        self._has_ended = False

    @override
    def property_changed(self, name: str) -> None:
        if not self.enable_last_sample:
            self.last_frame = None

    def note(self, frame: Frame) -> None:
        """Counts a frame that is rendered, and keeps it as the last one."""
        self.count += 1
        if self.enable_last_sample:
            self.last_frame = frame

    def check_open(self) -> None:
        """Raises `EndOfStream` after EOS."""
        if self._has_ended:
            raise EndOfStream(self.name)

    def drain(self) -> None:
        """Refuses frames after EOS."""
        self._has_ended = True

    def flush(self, *, begins: bool) -> None:
        """A flush lets the sink accept frames again, unless EOS has come from upstream."""
        super().flush(begins=begins)
        self._has_ended = self._has_ended and self.pads["sink"].has_upstream_ended


class StateFault(Choice):
    """State change that fails on purpose."""

    NONE = "none", 0, "No state change errors"
    NULL_TO_READY = "null-to-ready", 1, "Fail state change from NULL to READY"
    READY_TO_PAUSED = "ready-to-paused", 2, "Fail state change from READY to PAUSED"
    PAUSED_TO_PLAYING = "paused-to-playing", 3, "Fail state change from PAUSED to PLAYING"
    PLAYING_TO_PAUSED = "playing-to-paused", 4, "Fail state change from PLAYING to PAUSED"
    PAUSED_TO_READY = "paused-to-ready", 5, "Fail state change from PAUSED to READY"
    READY_TO_NULL = "ready-to-null", 6, "Fail state change from READY to NULL"


GOING_DOWN = (StateFault.PLAYING_TO_PAUSED, StateFault.PAUSED_TO_READY, StateFault.READY_TO_NULL)


class FakeSink(PlainSink):
    """Discards every frame; keeps the last one.

    Attributes:
        on_handoff: called with (frame, pad) for each frame, if `signal-handoffs` is on.
        on_preroll_handoff: the same for the preroll frame.

    Example:
        fakesrc num-buffers=10 ! fakesink
    """

    sink = "ANY"

    num_buffers: int = Property(-1, min=-1, max=INT, doc="Frames until the sink ends the stream; -1: never.")
    silent: bool = Property(True, live=True, doc="Post no message for each frame.")
    signal_handoffs: bool = Property(False, live=True, doc="Call `on_handoff` with each frame.")
    dump: bool = Property(False, live=True, doc="Post the bytes of each frame as a message.")
    drop_out_of_segment: bool = Property(True, doc="Drop frames outside the segment.")
    state_error: StateFault = Property(
        StateFault.NONE, doc="Fail at this state change: in `start`, or in `stop` for a change downwards."
    )
    last_message: str | None = Property(None, readonly=True, doc="The last action, unless silent.")
    can_activate_push: bool = Property(True, doc="Accepted, without effect: frames are always pushed.")
    can_activate_pull: bool = Property(False, doc="Accepted, without effect: frames are never pulled.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_handoff = Callbacks()
        self.on_preroll_handoff = Callbacks()
        super().__init__(name, **properties)

    def start(self) -> None:
        """Resets the counters, or fails on purpose."""
        super().start()
        fault = self.state_error
        if fault is not StateFault.NONE and fault not in GOING_DOWN:
            raise StateError(f"state-error={fault}: fails at this state change on purpose")

    def stop(self) -> None:
        """Stops, or fails on purpose."""
        super().stop()
        if self.state_error in GOING_DOWN:
            raise StateError(f"state-error={self.state_error}: fails at this state change on purpose")

    @override
    def clip(self, frame: Frame, pad: Pad) -> bool:
        return self.drop_out_of_segment and super().clip(frame, pad)

    @override
    def preroll(self, frame: Frame | None) -> None:
        if frame is not None and self.signal_handoffs:
            self.on_preroll_handoff.emit(frame, self.pads["sink"])

    @override
    def render(self, frame: Frame) -> None:
        self.check_open()
        pad, limit = self.pads["sink"], self.num_buffers
        if 0 <= limit <= self.count:
            raise EndOfStream(self.name)
        if self.clip(frame, pad):
            return
        self.note(frame)
        if not self.silent or self.dump or self.signal_handoffs:
            report_frame(self, "chain", pad, frame, frame, pad)
        if self.count == limit:
            raise EndOfStream(self.name)
