"""identity: passes frames on as they are; made for tests of what a pipeline does."""

from __future__ import annotations

import random

from streamkit.element.property import Property
from streamkit.element.transform import Transform
from streamkit.errors import StreamError
from streamkit.flow.frame import Frame
from streamkit.flow.signals import EndOfStream


class Identity(Transform):
    """Passes every frame on; may drop, delay or fail on purpose.

    Example:
        fakesrc num-buffers=10 ! identity drop-probability=0.5 ! fakesink
    """

    sink = src = "ANY"

    drop_probability: float = Property(0.0, min=0.0, max=1.0, doc="Share of frames dropped at random.")
    sleep_time: int = Property(0, min=0, unit="us", doc="Time to wait before each frame goes on.")
    error_after: int = Property(-1, min=-1, doc="Fails at the n-th frame; -1 is never.")
    eos_after: int = Property(-1, min=-1, doc="Ends the stream at the n-th frame; -1 is never.")
    silent: bool = Property(True, doc="Post no message for each frame.")
    seed: int = Property(0, doc="Of the random choice.")

    def start(self) -> None:
        """Begins to count."""
        self._random = random.Random(self.seed)
        self._count = 0

    def is_passthrough(self) -> bool:
        """Whether nothing is to be done."""
        return (
            self.drop_probability == 0
            and self.sleep_time == 0
            and self.error_after < 0
            and self.eos_after < 0
            and self.silent
        )

    def transform(self, frame: Frame) -> Frame | None:
        """Counts, delays, drops."""
        self._count += 1
        if self._count == self.error_after:
            raise StreamError(f"error-after={self.error_after}: the frame at which to fail has come")
        if self._count == self.eos_after:
            raise EndOfStream(self.name)
        if self.sleep_time:
            self.stopping.wait(self.sleep_time / 1e6)
        if not self.silent:
            self.post_message("frame", seq=frame.seq, pts=frame.pts, caps=str(frame.caps))
        if self.drop_probability and self._random.random() < self.drop_probability:
            self.count_drop("drop-probability")
            return None
        return frame
