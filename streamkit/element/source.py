"""Source: an element that makes frames, in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

from streamkit.element.base import AT_WORK, IDLE, Element
from streamkit.element.negotiation import allowed_caps, demand_accepted
from streamkit.element.pad import Pad
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import EOS, CapsEvent, DiscontinuityEvent, Event, SegmentEvent
from streamkit.flow.frame import Frame
from streamkit.flow.segment import Segment
from streamkit.flow.signals import EndOfStream, Flushing

HELD_LOOK_S = 1.0  # a held source is woken by `hold`, `finish` or `halt`; this bounds a missed wake-up


class _Exhausted(Exception):
    """The source has no more frames."""


class _NoPad:
    """Stands for the first src pad of a source whose pads only the stream brings."""

    def __init__(self, source: Source) -> None:
        self.source = source

    def push(self, frame: Frame) -> None:
        """Pushes into the pad that has come meanwhile."""
        self.source.src_pad.push(frame)


class Source(Element):
    """Base of sources: override `frames`, and `negotiate` where the format is yours to choose.

    Attributes:
        is_live: whether frames come at their own pace and are lost when nobody takes them.
        over: set once the stream is to end, or the pipeline stops: for what waits between two frames.
        src_pad: the pad that plain frames leave through.
    """

    is_live: bool = False

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.over = threading.Event()
        self._held = threading.Event()
        self._held.set()
        self._finishing = False
        self._check = False
        self._renegotiates = False
        self._flush_over = threading.Event()
        self._flush_over.set()
        self._epochs: dict[str, int] = {}
        self._numbers: dict[str, int] = {}
        self._segment = Segment()
        self._segment_epoch: int | None = None
        super().__init__(name, **properties)

    # What an author overrides.

    def duration_ns(self) -> int | None:
        """How long the stream is; None if it has no end or cannot tell."""
        return None

    def negotiate(self, allowed: Caps) -> Caps | None:
        """Chooses the fixed caps to produce out of `allowed`; None when only the data can tell."""
        return None if allowed.is_any else allowed.fixate()

    def frames(self) -> Iterator[Frame | tuple[str, Frame] | Event]:
        """Yields frames, or (pad name, frame) where there are several pads; returning means EOS.

        An event that is yielded goes to every pad, in order with the frames.
        """
        raise NotImplementedError

    # What the engine calls.

    @property
    def src_pad(self) -> Pad:
        """The first src pad."""
        return next(self.src_pads())

    def query_live(self) -> bool:
        """Whether this source is live."""
        return self.is_live

    def hold(self, held: bool) -> None:
        """Pauses or resumes the source between two frames."""
        if held:
            self._held.clear()
        else:
            self._held.set()
        self._check = held or self._finishing

    def finish(self) -> None:
        """Makes the source end its stream with EOS after the frame it is at; a wait for the next one ends."""
        self._finishing = self._check = True
        self.over.set()
        self._held.set()
        self.waking.set()
        self.interrupt()

    def wait_while_paused(self) -> bool:
        """Waits until the pipeline plays; False when ending, stopping or flushed away."""
        return not self.over.is_set() and super().wait_while_paused()

    def renegotiate(self) -> None:
        """Makes the source agree on caps with downstream anew before its next frame."""
        self._renegotiates = self._check = True

    def halt(self) -> None:
        """Makes the source leave its loop at the next frame: the pipeline is stopping."""
        super().halt()
        self._check = True
        self.over.set()
        self._held.set()
        self._flush_over.set()

    def flush(self, *, begins: bool) -> None:
        """Between the start and the stop of a flush the source waits; the frame on its way is dropped."""
        super().flush(begins=begins)
        if begins:
            self._flush_over.clear()
        else:
            self._flush_over.set()

    def prepare_run(self) -> None:
        """Forgets an earlier run's end."""
        self._finishing = self._check = self._renegotiates = False
        self.over.clear()
        self._held.set()
        self._flush_over.set()
        self._epochs, self._numbers = {}, {}
        self._segment_epoch = None

    def stream(self) -> None:
        """The body of the source's thread: negotiates, pushes every frame, then EOS."""
        try:
            with self.guarded():
                self._settle_before_data()
                self._push_all()
        except EndOfStream:
            pass
        if self.stopping.is_set():
            raise Flushing(self.name)
        for pad in list(self.src_pads()):
            pad.is_eos = True
            pad.send_event(EOS)

    def _settle_before_data(self) -> None:
        pad = next(self.src_pads(), None)
        if pad is None:  # the stream brings the pads, and their caps
            return
        caps = self.negotiate(allowed_caps(pad, ANY))
        if caps is not None and not caps.is_any:
            demand_accepted(pad, caps)
            pad.send_event(CapsEvent(caps))
        elif caps is not None:
            pad.caps = caps

    def _push_all(self) -> None:
        if self._check and self._must_end():  # a live source begins its work when the pipeline plays
            return
        frames = self.frames()
        pad, advance = next(self.src_pads(), None) or _NoPad(self), self._advance
        try:
            while True:
                try:
                    while True:
                        self.at_work[0] = AT_WORK
                        frame = advance(frames, pad)
                        self.at_work[0] = IDLE
                        pad.push(frame)
                except Flushing:
                    self._wait_for_flush_end()
        except _Exhausted:
            return
        finally:
            self.at_work[0] = IDLE
            close = getattr(frames, "close", None)
            if close is not None:
                close()

    def _wait_for_flush_end(self) -> None:
        """After a flush the stream goes on; the frame that met it is lost. A stop ends it."""
        if self.stopping.is_set():
            raise Flushing(self.name)
        self.count_drop("flushed")
        while not self._flush_over.wait(HELD_LOOK_S) and not self.stopping.is_set():
            continue

    def _advance(self, frames: Iterator[Frame | tuple[str, Frame] | Event], main: Pad | _NoPad) -> Frame:
        """The next frame for the first src pad, `main`; frames for other pads are pushed on the way."""
        if self._check and self._must_end():
            raise _Exhausted
        for item in frames:
            if self._check and self.is_live and not self._held.is_set():
                self.count_drop("paused")  # it would be old news when the pipeline goes on
                if self._must_end():
                    break
                continue
            if isinstance(item, Frame):
                return self._prepared(main if isinstance(main, Pad) else self.src_pad, item)
            if not isinstance(item, tuple):
                for pad in list(self.src_pads()):
                    pad.send_event(item)
                continue
            pad = self.pads[item[0]]
            if pad is main:
                return self._prepared(pad, item[1])
            if pad.peer is not None:
                pad.push(self._prepared(pad, item[1]))
        raise _Exhausted

    def _prepared(self, pad: Pad, frame: Frame) -> Frame:
        """The frame with caps, number and arrival, after the events that must come before it."""
        if frame.caps is not pad.caps:
            frame = self._settle(pad, frame)
        if not frame.arrival_ns:
            number = self._numbers.get(pad.name, -1) + 1
            self._numbers[pad.name] = number
            frame = frame.replace(seq=frame.seq or number, arrival_ns=self.clock_ns())
        if frame.epoch != self._epochs.get(pad.name, -1):
            self._begin_epoch(pad, frame)
        return frame

    def _begin_epoch(self, pad: Pad, frame: Frame) -> None:
        """Tells downstream where the timestamps of the first frame, or of a new epoch, lie."""
        known = self._epochs.get(pad.name)
        self._epochs[pad.name] = frame.epoch
        if frame.epoch != (known or 0):
            pad.send_event(DiscontinuityEvent(frame.epoch))
        if self._segment_epoch != frame.epoch:
            is_late = self.is_live or self._segment_epoch is not None
            self._segment_epoch = frame.epoch
            self._segment = Segment(frame.pts or 0, None, self.timing.running_time_ns() if is_late else 0)
        pad.send_event(SegmentEvent(self._segment))

    def _must_end(self) -> bool:
        while not self._held.wait(HELD_LOOK_S) and not self.stopping.is_set():
            continue
        if self.stopping.is_set():
            raise Flushing(self.name)
        if self._renegotiates:
            self._renegotiates = False
            self._settle_anew()
        self._check = self._finishing
        return self._finishing

    def _settle_anew(self) -> None:
        """Downstream has changed what it takes: caps that still do are sent again, else others are chosen."""
        pad = next(self.src_pads(), None)
        if pad is None or pad.caps is None or pad.caps.is_any:
            self._settle_before_data()
            return
        if (pad.caps & pad.peer_caps()).is_empty:
            caps = self.negotiate(allowed_caps(pad, ANY))
            if caps is not None and not caps.is_any:
                pad.caps = caps
        for other in list(self.src_pads()):
            if other.caps is not None and other.peer is not None:
                demand_accepted(other, other.caps)
                other.send_event(CapsEvent(other.caps))

    def _settle(self, pad: Pad, frame: Frame) -> Frame:
        """The frame with the pad's caps, after telling downstream when they are new."""
        caps = frame.caps
        if pad.caps is not None and caps == pad.caps:
            return frame.replace(caps=pad.caps)
        demand_accepted(pad, caps)
        pad.send_event(CapsEvent(caps))
        return frame

    def receive_event(self, pad: Pad, event: Event) -> None:
        """A source has no sink pads: nothing arrives."""
