"""appsink: frames to the application."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator
from typing import Any

from streamkit.element.property import Property
from streamkit.element.sink import Sink
from streamkit.errors import StateError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.frame import Frame
from streamkit.flow.signals import EndOfStream, Flushing

POLL_S = 0.2


class AppSink(Sink):
    """Holds frames for the application: iterate over it, or call `pull`.

    Example:
        videotestsrc num-buffers=5 ! appsink name=out
    """

    sink = "ANY"

    caps: Caps = Property(ANY, doc="What it takes.")
    max_buffers: int = Property(64, min=0, doc="Frames held at most; 0 is no limit.")
    drop: bool = Property(False, live=True, doc="Drop the oldest frame when full, instead of waiting.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._frames: deque[Frame] = deque()
        self._changed = threading.Condition()
        self._ended = False
        super().__init__(name, **properties)

    def query_caps(self, pad: Any) -> Caps:
        """The property `caps`."""
        return self.caps

    def start(self) -> None:
        """Forgets an earlier run."""
        self._frames.clear()
        self._ended = False

    def render(self, frame: Frame) -> None:
        """Lines the frame up; waits or drops the oldest when full."""
        with self._changed:
            while self.max_buffers and len(self._frames) >= self.max_buffers:
                if self.drop:
                    self._frames.popleft()
                    self.count_drop("appsink full, oldest dropped")
                    continue
                if self.stopping.is_set():
                    raise Flushing(self.name)
                if self._ended:
                    raise EndOfStream(self.name)
                self._changed.wait(POLL_S)
            self._frames.append(frame)
            self._changed.notify_all()

    def drain(self) -> None:
        """EOS: who waits for frames is told."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def interrupt(self) -> None:
        """Wakes who waits."""
        with self._changed:
            self._changed.notify_all()

    def pull(self, timeout_s: float = 5.0) -> Frame | None:
        """The next frame; None at EOS.

        Raises:
            StateError: none has come within `timeout_s`, or the pipeline does not play.
            ElementFailure: the pipeline has failed.
        """
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while not self._frames:
                if self._ended:
                    self._raise_failure()
                    return None
                self._raise_failure()
                if not self.is_playing or self.stopping.is_set():
                    raise StateError(f"{self.name}: no frames: the pipeline does not play; call play() first")
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    raise StateError(f"{self.name}: no frame has come within {timeout_s} s")
                self._changed.wait(min(left_s, POLL_S))
            frame = self._frames.popleft()
            self._changed.notify_all()
            return frame

    def _raise_failure(self) -> None:
        failure = self.pipeline_error()
        if failure is not None:
            raise failure

    def __iter__(self) -> Iterator[Frame]:
        """Frames until EOS; raises the pipeline's error if it fails."""
        while (frame := self.pull(timeout_s=60.0)) is not None:
            yield frame
