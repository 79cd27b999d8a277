"""appsrc: frames from the application."""

from __future__ import annotations

import queue
import time
from collections.abc import Iterator
from typing import Any

from streamkit.element.property import Property
from streamkit.element.source import Source
from streamkit.errors import StateError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.frame import Frame

POLL_S = 0.2


class AppSrc(Source):
    """Pushes what the application gives it with `push`; `end` closes the stream.

    Example:
        appsrc name=in ! fakesink
    """

    src = "ANY"

    caps: Caps = Property(ANY, doc="Caps of frames that are pushed as bare data.")
    max_buffers: int = Property(16, min=1, doc="Frames waiting before `push` blocks.")
    block: bool = Property(True, live=True, doc="`push` waits for room; else it drops the oldest frame.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._line: queue.Queue[Frame | None] = queue.Queue()
        self._closed = False
        super().__init__(name, **properties)

    def stop(self) -> None:
        """Forgets the frames of this run that nobody took; those pushed before the next are kept."""
        self._line = queue.Queue()
        self._closed = False

    def negotiate(self, allowed: Caps) -> Caps | None:
        """The caps given, or those of the first frame."""
        return (allowed & self.caps) if self.caps.is_fixed else None

    def push(self, item: Any, timeout_s: float = 5.0, **fields: Any) -> None:
        """Gives a frame, or bare data with fields such as `pts`, to the pipeline.

        Raises:
            StateError: there has been no room within `timeout_s`, or `end` has been called.
            ElementFailure: the pipeline has failed.
        """
        if self._closed:
            raise StateError(f"{self.name}: no frame can follow end(); stop the pipeline to begin anew")
        frame = item if isinstance(item, Frame) else Frame(item, self.caps, **fields)
        deadline_s = time.monotonic() + timeout_s
        while self._line.qsize() >= self.max_buffers > 0 and self.is_playing:
            if not self.block:
                self._drop_oldest()
                continue
            failure = self.pipeline_error()
            if failure is not None:
                raise failure
            if self.stopping.is_set() or time.monotonic() > deadline_s:
                raise StateError(
                    f"{self.name}: no room for a frame within {timeout_s} s: nothing downstream takes it"
                )
            self.stopping.wait(0.001)
        self._line.put(frame)

    def _drop_oldest(self) -> None:
        try:
            self._line.get_nowait()
            self.count_drop("appsrc full, oldest dropped")
        except queue.Empty:
            return

    def end(self) -> None:
        """No frame follows."""
        self._closed = True
        self._line.put(None)

    def frames(self) -> Iterator[Frame]:
        """What was pushed, in order."""
        while not self.stopping.is_set():
            try:
                frame = self._line.get(timeout=POLL_S)
            except queue.Empty:
                if self._finishing:
                    return
                continue
            if frame is None:
                return
            yield frame
