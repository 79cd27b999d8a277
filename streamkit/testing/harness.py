"""A harness: one element, frames in by hand, frames and messages out."""

from __future__ import annotations

from types import TracebackType
from typing import Any, Self

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.registry import make_element
from streamkit.element.sink import Sink
from streamkit.errors import StateError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.clock import Clock
from streamkit.flow.events import (
    EOS,
    FLUSH_START,
    FLUSH_STOP,
    CapsEvent,
    DiscontinuityEvent,
    Event,
    SegmentEvent,
)
from streamkit.flow.frame import Frame
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.segment import Segment
from streamkit.graph.chain import Chain


class _Feed(Element):
    """Stands upstream of the element under test."""

    templates = (PadTemplate("src", Direction.SRC, ANY),)


class _Collect(Sink):
    """Stands downstream of it."""

    sink = "ANY"
    accepts: Caps = ANY

    def __init__(self, name: str, frames: list[Frame]) -> None:
        super().__init__(name)
        self.frames = frames

    def query_caps(self, pad: Pad) -> Caps:
        return self.accepts

    def render(self, frame: Frame) -> None:
        self.frames.append(frame)


class Harness:
    """Runs one element in the calling thread, and is its host: pads that it adds meanwhile are collected too.

    Attributes:
        element: the element under test.
        messages: what it posted.
        has_all_pads: whether it has said that no more pads come.
        has_ended: whether it is a sink and has finished all that came before EOS.
    """

    def __init__(
        self,
        element: str | Element,
        *,
        downstream: str | Caps = ANY,
        clock: Clock | None = None,
        **properties: Any,
    ) -> None:
        """Starts the element.

        Args:
            element: its type, or an instance.
            downstream: the caps that stand behind it.
            clock: another clock than the machine's.
            **properties: set on an element given by its type.
        """
        self.element = make_element(element, **properties) if isinstance(element, str) else element
        self.messages: list[Message] = []
        self._frames: list[Frame] = []
        self._feeds: dict[str, _Feed] = {}
        self.element.poster = self.messages.append
        if clock is not None:
            self.element.clock = clock
        self.element.host = self
        self.has_all_pads = self.has_ended = False
        self._downstream = Caps(downstream)
        for template in self.element.pad_templates.values():
            if template.presence is Presence.REQUEST:
                self.element.request_pad(template)
        for pad in self.element.pads.values():
            self._surround(pad)
        for owner in [*self._feeds.values(), self.element]:  # once all is linked
            for pad in owner.src_pads():
                pad.push = Chain(pad).push
        self._epochs: dict[str, int] = {}
        self._open = True
        try:
            self.element.start()
        except BaseException:
            self.close()
            raise
        self.element.is_playing = True

    def _surround(self, pad: Pad) -> None:
        if pad.is_src:
            collect = _Collect(f"collect_{pad.name}", self._frames)
            collect.accepts = self._downstream
            collect.poster = self.messages.append
            pad.link(collect.pads["sink"])
        else:
            feed = self._feeds[pad.name] = _Feed(f"feed_{pad.name}")
            feed.pads["src"].link(pad)

    def push(self, frame: Frame, pad: str = "sink") -> list[Frame]:
        """Sends a frame in, its caps first when they are new; what came out meanwhile."""
        src = self._feed(pad)
        if src.caps is None or frame.caps != src.caps:
            src.send_event(CapsEvent(frame.caps))
        elif frame.caps is not src.caps:
            frame = frame.replace(caps=src.caps)
        if frame.epoch != self._epochs.get(pad):
            if frame.epoch != self._epochs.get(pad, 0):
                src.send_event(DiscontinuityEvent(frame.epoch))
            self._epochs[pad] = frame.epoch
            base_ns = self.element.timing.running_time_ns()
            src.send_event(SegmentEvent(Segment(frame.pts or 0, None, base_ns)))
        src.push(frame)
        return self.take()

    def send(self, event: Event, pad: str = "sink") -> list[Frame]:
        """Sends an event in, for example a gap; what came out meanwhile."""
        self._feed(pad).send_event(event)
        return self.take()

    def flush(self) -> list[Frame]:
        """Sends a flush through every sink pad: what was held is dropped; what came out meanwhile."""
        for event in (FLUSH_START, FLUSH_STOP):
            for pad in self._feeds:
                self._feed(pad).send_event(event)
        self._epochs.clear()
        return self.take()

    def drain(self) -> list[Frame]:
        """Sends EOS; what came out."""
        for pad in self._feeds:
            self._feed(pad).send_event(EOS)
        return self.take()

    def take(self) -> list[Frame]:
        """What has come out since the last look."""
        frames = self._frames[:]
        self._frames.clear()
        return frames

    def _feed(self, pad: str) -> Pad:
        if not self._open:
            raise StateError("the harness is closed")
        return self._feeds[pad].pads["src"]

    # What the element calls.

    def pad_added(self, pad: Pad) -> None:
        """Feeds or collects from a new pad."""
        self._surround(pad)
        src = pad if pad.is_src else self._feeds[pad.name].pads["src"]
        src.push = Chain(src).push

    def no_more_pads(self, element: Element) -> None:
        """The element has all its pads."""
        self.has_all_pads = True

    def reconfigure(self, element: Element) -> None:
        """Negotiates anew before the next frame."""
        for feed in self._feeds.values():
            feed.pads["src"].caps = None

    def sink_ended(self, element: Element) -> None:
        """The element is a sink and has drained."""
        self.has_ended = True
        self.messages.append(Message(MessageKind.EOS, element.name))

    def prerolled(self, element: Element) -> None:
        """Nothing waits for it: a harness never pauses."""

    def close(self) -> None:
        """Stops the element."""
        if self._open:
            self._open = False
            self.element.stopping.set()
            self.element.interrupt()
            self.element.is_playing = False
            self.element.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
