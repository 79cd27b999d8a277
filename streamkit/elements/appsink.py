"""appsink: frames for the application."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

from typing_extensions import override

from streamkit.element.frame_queue import FrameHolder
from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.property_text import UINT, UINT64
from streamkit.elements.fakesink import PlainSink
from streamkit.elements.frame_report import Callbacks, wait_for_change
from streamkit.errors import StateError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import EosEvent, Event, FlushEvent
from streamkit.flow.frame import Frame

ITERATION_TIMEOUT_S = 60.0


class AppSink(FrameHolder, PlainSink):
    """Queues frames for the application: iterate over the element, or call `pull`.

    Attributes:
        on_new_sample: called with the element for each frame, if `emit-signals` is on.
        on_new_preroll: the same for the preroll frame.
        on_eos: called with the element at EOS.

    Example:
        videotestsrc num-buffers=5 ! appsink name=out
    """

    sink = "ANY"

    caps: Caps | None = Property(ANY, doc="Accepted caps.")
    max_buffers: int = Property(64, min=0, max=UINT, live=True, doc="Frame limit; 0 is none.")
    max_bytes: int = Property(0, min=0, max=UINT64, live=True, unit="bytes", doc="Size limit; 0 is none.")
    max_time: int = Property(0, min=0, max=UINT64, live=True, unit="ns", doc="Time limit; 0 is none.")
    drop: bool = Property(False, live=True, doc="Drop the oldest frame if full instead of waiting.")
    eos: bool = Property(True, read=lambda s: s._is_over(), doc="Whether nothing more can be pulled.")
    emit_signals: bool = Property(False, live=True, doc="Call `on_new_sample` and the other callbacks.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_new_sample, self.on_new_preroll, self.on_eos = Callbacks(), Callbacks(), Callbacks()
        self._preroll: Frame | None = None
        self._was_started = False
        super().__init__(name, **properties)

    @override
    def query_caps(self, pad: Pad) -> Caps:
        return self.caps or ANY

    @override
    def start(self) -> None:
        super().start()
        self._forget()
        self._was_started = True

    def stop(self) -> None:
        """Wakes waiting callers; queued frames stay until the next start."""
        super().stop()
        self._was_started = False
        self.wake()

    def _forget(self) -> None:
        with self.changed:
            self.pending.reset()
            self._preroll = None
            self.changed.notify_all()

    # Called in the streaming thread.

    def preroll(self, frame: Frame | None) -> None:
        """Stores the preroll frame; it is rendered again when the pipeline plays."""
        with self.changed:
            self._preroll = frame
            self.changed.notify_all()
        if frame is not None and self.emit_signals:
            self.on_new_preroll.emit(self)

    def render(self, frame: Frame) -> None:
        """Queues the frame; waits, or drops the oldest, if full."""
        if self.clip(frame, self.pads["sink"]):
            return
        with self.changed:
            self.check_open()
            self.wait_for(self._make_room)
            self.note(frame)
            self.pending.append(frame)
            self.changed.notify_all()
        if self.emit_signals:
            self.on_new_sample.emit(self)

    def _make_room(self) -> bool:
        """Drops the oldest frames with `drop`; whether there is room for another."""
        while self.drop and self.pending.is_full() and self.pending.drop_oldest():
            self.count_drop("appsink full, oldest dropped")
        return not self.pending.is_full()

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Queues events between the frames, for `pull_object`."""
        if not isinstance(event, EosEvent | FlushEvent):
            with self.changed:
                self.pending.append(event)
                self.changed.notify_all()
        super().receive_event(pad, event)

    @override
    def drain(self) -> None:
        super().drain()
        self.wake()
        if self.emit_signals:
            self.on_eos.emit(self)

    @override
    def flush(self, *, begins: bool) -> None:
        super().flush(begins=begins)
        with self.changed:
            self.count_drop("flushed", self.pending.buffers)
            self._forget()

    # Called by the application.

    def _is_over(self) -> bool:
        return not self._was_started or (self._has_ended and not self.pending.buffers)

    def pull(self, timeout_s: float = 5.0) -> Frame | None:
        """The next frame; None at EOS.

        Raises:
            StateError: none arrived within `timeout_s`, or the pipeline does not play.
            ElementFailure: the pipeline has failed.
        """
        frame = self.try_pull(timeout_s)
        if frame is None and not (self._has_ended and not self.pending.buffers):
            if not self.is_playing or self.stopping.is_set():
                raise StateError(f"{self.name}: no frames: the pipeline does not play; call play() first")
            raise StateError(f"{self.name}: no frame has come within {timeout_s} s")
        return frame

    def try_pull(self, timeout_s: float = 0.0) -> Frame | None:
        """The next frame; None at the timeout or EOS.

        Raises:
            ElementFailure: the pipeline has failed.
        """
        deadline_s = time.monotonic() + timeout_s
        while True:
            item = self.pull_object(deadline_s - time.monotonic())
            if item is None or isinstance(item, Frame):
                return item

    def pull_object(self, timeout_s: float = 5.0) -> Frame | Event | None:
        """The next frame or event, in order; None at the timeout or EOS.

        Raises:
            ElementFailure: the pipeline has failed.
        """
        with self.changed:
            if not wait_for_change(
                self,
                lambda: bool(self.pending.items),
                lambda: self._has_ended or not self.is_playing,
                timeout_s,
            ):
                return None
            item = self.pending.popleft()
            if isinstance(item, Frame):
                self._preroll = None
            self.changed.notify_all()
            return item

    def pull_preroll(self, timeout_s: float = 5.0) -> Frame | None:
        """The preroll frame of the paused pipeline, once; None at the timeout.

        Raises:
            ElementFailure: the pipeline has failed.
        """
        with self.changed:
            wait_for_change(self, lambda: self._preroll is not None, self._is_over, timeout_s)
            frame, self._preroll = self._preroll, None
            return frame

    def __iter__(self) -> Iterator[Frame]:
        """Iterates over frames until EOS, or until another thread stops the pipeline.

        Raises:
            StateError: the pipeline does not play, or no frame came for 60 s; a live source may rest longer.
            ElementFailure: the pipeline has failed.
        """
        has_played = False
        while True:
            has_played = has_played or (self.is_playing and not self.stopping.is_set())
            try:
                frame = self.pull(math.inf if self.query_live() else ITERATION_TIMEOUT_S)
            except StateError:
                if has_played and self.stopping.is_set():
                    return
                raise
            if frame is None:
                return
            yield frame
