"""PlainSink: common base class of fakesink and appsink."""

from __future__ import annotations

from typing import Any

from typing_extensions import override

from streamkit.element.property import Property
from streamkit.element.property_text import UINT
from streamkit.element.sink import Sink
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
