"""fakesink: takes frames and forgets them."""

from __future__ import annotations

from streamkit.element.property import Property
from streamkit.element.sink import Sink
from streamkit.flow.frame import Frame
from streamkit.flow.signals import EndOfStream


class FakeSink(Sink):
    """Takes every frame and does nothing with it; keeps the last one.

    Example:
        fakesrc num-buffers=10 ! fakesink
    """

    sink = "ANY"

    num_buffers: int = Property(-1, min=-1, doc="Frames before the sink ends the stream; -1 is never.")
    silent: bool = Property(True, doc="Post no message for each frame.")
    enable_last_sample: bool = Property(True, live=True, doc="Keep the last frame in `last_frame`.")

    def start(self) -> None:
        """Begins to count."""
        self.count = 0
        self.last_frame: Frame | None = None

    def render(self, frame: Frame) -> None:
        """Counts the frame."""
        if 0 <= self.num_buffers <= self.count:
            raise EndOfStream(self.name)
        self.count += 1
        if self.enable_last_sample:
            self.last_frame = frame
        if not self.silent:
            self.post_message("frame", seq=frame.seq, pts=frame.pts, caps=str(frame.caps))
        if self.count == self.num_buffers:
            raise EndOfStream(self.name)
