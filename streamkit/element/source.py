"""Source: an element that produces frames in its own thread."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterable, Iterator
from typing import Any

from typing_extensions import override

from streamkit.element.base import AT_WORK, IDLE, Element
from streamkit.element.pad import Pad
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import (
    CapsEvent,
    DiscontinuityEvent,
    EndOfStream,
    Event,
    Flushing,
    Segment,
    SegmentEvent,
)
from streamkit.flow.frame import Frame
from streamkit.flow.video import check_layout, display_size, is_raw_video


class Source(Element):
    """Base class of sources: override `frames`, and `negotiate` if the element chooses the format.

    Attributes:
        is_live: whether frames arrive at their own pace and are lost if nothing takes them.
        over: set when the stream is to end or the pipeline stops; waits between two frames check it.
        position_ns: timestamp of the newest frame, or None.
    """

    is_live: bool = False

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.over = threading.Event()
        super().__init__(name, **properties)

    @override
    def begin_run(self) -> None:
        super().begin_run()
        self._segment = Segment()
        self._chosen = ANY
        self._renegotiates = False
        self.over.clear()
        self._epochs: dict[str, int] = {}
        self._numbers: dict[str, int] = {}
        self._segment_epoch: int | None = None
        self.position_ns: int | None = None

    @property
    @override
    def src_caps(self) -> Caps:
        """Current caps of the pad `src`; before the first frame those chosen by `negotiate`, else ANY."""
        caps = super().src_caps
        return self._chosen if caps.is_any else caps

    # Overridden by authors.

    def duration_ns(self) -> int | None:
        """Length of the stream, ns; None if it is endless or unknown, as before the start."""
        return None

    def negotiate(self, allowed: Caps) -> Caps | None:
        """Chooses fixed caps out of `allowed`; None if only the data can tell."""
        return None if allowed.is_any else allowed.fixate()

    def frames(self) -> Iterator[Frame | tuple[str, Frame] | Event]:
        """Yields frames, (pad name, frame) pairs, or events for every pad, in order; returning means EOS."""
        raise NotImplementedError(f"{type(self).__name__} does not define frames")

    # Called by the engine.

    @override
    def query_live(self) -> bool:
        return self.is_live

    def finish(self) -> None:
        """Ends the stream with EOS after the current frame; cancels a wait for the next one."""
        self.over.set()
        self.wake()
        self.interrupt()

    @override
    def must_give_up(self, flushes: int) -> bool:
        return self.over.is_set() or super().must_give_up(flushes)

    def renegotiate(self) -> None:
        """Renegotiates caps with downstream before the next frame."""
        self._renegotiates = True

    def halt(self) -> None:
        """Ends streaming before the next frame because the pipeline stops."""
        self.over.set()
        super().halt()

    def stream(self) -> None:
        """Body of the source's thread: negotiates, pushes every frame, then EOS."""
        with contextlib.suppress(EndOfStream), self.guarded():
            self._negotiate_first()
            self._push_all()
        for pad in list(self.src_pads()):
            pad.send_eos()

    def _negotiate_first(self) -> None:
        pad = next(self.src_pads(), None)
        if pad is None:  # the stream brings the pads, and their caps
            return
        caps = self.negotiate(pad.allowed_caps(ANY))
        if caps is None:
            return
        if caps.is_any:
            pad.caps = caps
            return
        pad.check_accepted(caps)
        self._chosen = caps
        if not is_raw_video(caps) or display_size(caps) is not None:
            pad.send_event(CapsEvent(caps))  # else the first frame sends its own, which have the size

    def _push_all(self) -> None:
        if not self._await_next():  # a live source starts only when the pipeline plays
            return
        made = self.frames()
        if not isinstance(made, Iterable):
            raise TypeError(f"frames() must yield frames, as a generator does, got {type(made).__name__}")
        frames = iter(made)
        main = next(self.src_pads(), None)  # None: the stream brings the pads
        try:
            while self._await_next():
                try:
                    self.at_work[0] = AT_WORK
                    item = next(frames, None)
                    self.at_work[0] = IDLE
                    if item is None:
                        return
                    self._push(item, main)
                except Flushing:
                    self.wait_while_flushing()
                    self.count_drop("flushed")  # the frame that met the flush is lost
        finally:
            self.at_work[0] = IDLE
            close = getattr(frames, "close", None)
            if close is not None:
                close()

    def _push(self, item: Frame | tuple[str, Frame] | Event, main: Pad | None) -> None:
        """Pushes a frame, completed and after the events that precede it; sends an event through all pads.

        Raises:
            TypeError: the item is none of them.
        """
        if self.is_live and self._is_paused():
            self.count_drop("paused")  # stale by the time the pipeline resumes
            return
        if isinstance(item, Event):
            for pad in list(self.src_pads()):
                pad.send_event(item)
            return
        name, frame = item if isinstance(item, tuple) and len(item) == 2 else (None, item)
        if not isinstance(frame, Frame):
            raise TypeError(
                f"frames() yields Frame, (pad name, Frame) or Event, got {type(item).__name__}: "
                "put data into a frame with Frame(data, caps)"
            )
        if name is not None and name not in self.pads:
            self.check_declares_src(name)
            return
        pad = main or self.src_pad if name is None else self.pads[name]
        if name is not None and pad is not main and pad.peer is None:
            return
        try:
            check_layout(frame)
        except ValueError as error:
            raise self.failure(error, frame) from error
        if frame.caps is not pad.caps:
            frame = pad.announce_caps(frame)
        if not frame.arrival_ns:
            number = self._numbers.get(pad.name, -1) + 1
            self._numbers[pad.name] = number
            frame = frame.replace(seq=frame.seq or number, arrival_ns=self.clock.monotonic_ns())
        if frame.epoch != self._epochs.get(pad.name, -1):
            self._begin_epoch(pad, frame)
        self.position_ns = frame.pts
        pad.push(frame)

    def _begin_epoch(self, pad: Pad, frame: Frame) -> None:
        """Sends the segment of the first frame or of a new epoch."""
        known = self._epochs.get(pad.name)
        self._epochs[pad.name] = frame.epoch
        if frame.epoch != (known or 0):
            pad.send_event(DiscontinuityEvent(frame.epoch))
        if self._segment_epoch != frame.epoch:
            is_late = self.is_live or self._segment_epoch is not None
            self._segment_epoch = frame.epoch
            self._segment = Segment(frame.pts or 0, None, self.timing.running_time_ns() if is_late else 0)
        pad.send_event(SegmentEvent(self._segment))

    def _is_paused(self) -> bool:
        return not (self.timing.running.is_set() or self.over.is_set())

    def _await_next(self) -> bool:
        """Waits while a live source is paused, and renegotiates if asked to; False if the stream ends.

        Raises:
            Flushing: the pipeline stops.
        """
        if self.is_live and self._is_paused():
            self.wait_for_state(lambda: not self._is_paused())
        if self.stopping.is_set():
            raise Flushing(self.name)
        if self._renegotiates:
            self._renegotiates = False
            self._renegotiate()
        return not self.over.is_set()

    def _renegotiate(self) -> None:
        """Sends the caps again if downstream still accepts them, else chooses others."""
        pad = next(self.src_pads(), None)
        if pad is None or pad.caps is None or pad.caps.is_any:
            self._negotiate_first()
            return
        if not pad.caps.can_intersect(pad.peer_caps()):
            caps = self.negotiate(pad.allowed_caps(ANY))
            if caps is not None and not caps.is_any:
                pad.caps = caps
        for other in list(self.src_pads()):
            if other.caps is not None and other.peer is not None:
                other.check_accepted(other.caps)
                other.send_event(CapsEvent(other.caps))
