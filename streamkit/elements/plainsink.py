"""PlainSink: what fakesink and appsink share besides the base of all sinks."""

from __future__ import annotations

from typing import Any

from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.sink import Sink
from streamkit.flow.events import Event, SegmentEvent
from streamkit.flow.frame import Frame
from streamkit.flow.segment import Segment
from streamkit.flow.signals import EndOfStream

UINT = 2**32 - 1
UINT64 = 2**64 - 1


class PlainSink(Sink):
    """A sink that counts frames, keeps the last one, and refuses what comes after EOS.

    Attributes:
        count: frames taken since the start.
        last_frame: the newest, or None where `enable_last_sample` is off.
    """

    enable_last_sample: bool = Property(True, live=True, doc="Keep the last frame in `last_frame`.")
    blocksize: int = Property(4096, min=0, max=UINT, doc="Accepted, without effect: frames are never pulled.")
    stats: str = Property("", read=lambda sink: sink._stats(), doc="Frames rendered and dropped.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.count = 0
        self.last_frame: Frame | None = None
        self._keeps_last = True
        self._has_ended = False
        self._clip: Segment | None = None
        super().__init__(name, **properties)

    def _stats(self) -> str:
        dropped = sum(self.drops.values())
        return f"application/x-sink-stats, rendered={self.count}, dropped={dropped}"

    def start(self) -> None:
        """Begins to count."""
        self.count = 0
        self.last_frame = None
        self._has_ended = False
        self._clip = None
        self.settle()

    def stop(self) -> None:
        """Ends what `start` began; the last frame stays for who asks."""

    def settle(self) -> None:
        """What has been set is to count from the next frame on."""
        self._keeps_last = self.enable_last_sample
        if not self._keeps_last:
            self.last_frame = None

    def property_changed(self, name: str) -> None:
        """Counts at once."""
        self.settle()

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Notes where the stream is to be clipped; the rest is the base's."""
        if isinstance(event, SegmentEvent):
            segment = event.segment
            self._clip = segment if segment.start_ns or segment.stop_ns is not None else None
            self.settle()
        super().receive_event(pad, event)

    def is_outside(self, frame: Frame) -> bool:
        """Whether no part of a frame lies in the segment; it is then counted as dropped."""
        clip = self._clip
        if clip is None or frame.pts is None or clip.holds(frame.pts, frame.duration):
            return False
        self.count_drop("outside the segment")
        return True

    def demand_open(self) -> None:
        """Raises `EndOfStream` where the stream has ended."""
        if self._has_ended:
            raise EndOfStream(self.name)

    def drain(self) -> None:
        """EOS: frames that follow are refused."""
        self._has_ended = True
        self.settle()

    def flush(self, *, begins: bool) -> None:
        """A flush opens the sink anew."""
        super().flush(begins=begins)
        self._has_ended = False
        self._clip = None
        self.settle()
