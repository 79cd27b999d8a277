"""Harness: runs one element on given frames; collects its frames and messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

from streamkit.element.base import Element, Host
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
    Segment,
    SegmentEvent,
)
from streamkit.flow.frame import Frame
from streamkit.flow.messages import Message
from streamkit.graph.chain import Chain


class _TestSource(Element):
    """Upstream of the element under test."""

    templates = (PadTemplate("src", Direction.SRC, ANY),)


class _TestSink(Sink):
    """Downstream of the element under test."""

    sink = "ANY"
    accepts: Caps = ANY

    def __init__(self, name: str, frames: list[Frame]) -> None:
        super().__init__(name)
        self.frames = frames

    def query_caps(self, pad: Pad) -> Caps:
        return self.accepts

    def render(self, frame: Frame) -> None:
        self.frames.append(frame)


class Harness(Host):
    """Runs one element in the calling thread, as its host; what a source gives needs a `Pipeline`.

    Attributes:
        element: the element under test.
        messages: posted by the element.
        has_all_pads: whether the element has called `no_more_pads`.
        has_ended: whether a sink has drained after EOS.
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
            element: element type, or an instance.
            downstream: caps that downstream accepts.
            clock: instead of the system clock.
            **properties: of an element given by its type.

        Raises:
            TypeError: it is neither.
        """
        if not isinstance(element, str | Element):
            raise TypeError(f"Harness takes the name of an element, or an instance, got {element!r}")
        self.element = make_element(element, **properties) if isinstance(element, str) else element
        self.messages: list[Message] = []
        self._frames: list[Frame] = []
        self._sources: dict[str, _TestSource] = {}
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
            self._connect(pad)
        for owner in [*self._sources.values(), self.element]:  # after all links
            for pad in owner.src_pads():
                pad.push = Chain(pad).push
        self._epochs: dict[str, int] = {}
        self._open = True
        try:
            self.element.start()
            self.element.begin_run()
        except BaseException:
            self.close()
            raise
        self.element.is_playing = True

    def _connect(self, pad: Pad) -> None:
        if pad.is_src:
            sink = _TestSink(f"collect_{pad.name}", self._frames)
            sink.accepts = self._downstream
            sink.poster = self.messages.append
            pad.link(sink.pads["sink"])
        else:
            source = self._sources[pad.name] = _TestSource(f"feed_{pad.name}")
            source.pads["src"].link(pad)

    def push(self, frame: Frame, pad: str = "sink") -> list[Frame]:
        """Pushes a frame, after its caps if they are new; returns the output.

        Raises:
            TypeError: it is no frame.
            StateError: the element has no such sink pad, or the harness is closed.
        """
        if not isinstance(frame, Frame):
            raise TypeError(f"push takes a Frame, got {type(frame).__name__}: write Frame(data, caps)")
        src = self._feed(pad)
        if src.caps is None or frame.caps != src.caps:
            src.send_event(CapsEvent(frame.caps))
        elif frame.caps is not src.caps:
            frame = frame.replace(caps=src.caps)
        if frame.epoch != self._epochs.get(pad):
            if frame.epoch != self._epochs.get(pad, 0):  # a stream begins with epoch 0
                src.send_event(DiscontinuityEvent(frame.epoch))
            self._epochs[pad] = frame.epoch
            base_ns = self.element.timing.running_time_ns()
            src.send_event(SegmentEvent(Segment(frame.pts or 0, None, base_ns)))
        src.push(frame)
        return self.take()

    def send(self, event: Event, pad: str = "sink") -> list[Frame]:
        """Sends an event, for example a gap; returns the output."""
        self._feed(pad).send_event(event)
        return self.take()

    def flush(self) -> list[Frame]:
        """Flushes every sink pad; returns the output."""
        for event in (FLUSH_START, FLUSH_STOP):
            for pad in self._sources:
                self._feed(pad).send_event(event)
        self._epochs.clear()
        return self.take()

    def drain(self) -> list[Frame]:
        """Sends EOS to every sink pad; returns the output."""
        for pad in self._sources:
            self._feed(pad).send_event(EOS)
        return self.take()

    def take(self) -> list[Frame]:
        """Returns the output since the last call."""
        frames = self._frames[:]
        self._frames.clear()
        return frames

    def _feed(self, pad: str) -> Pad:
        if not self._open:
            raise StateError("the harness is closed")
        if pad not in self._sources:
            known = ", ".join(self._sources) or "none: a source runs in a Pipeline"
            raise StateError(f"{self.element.name} has no sink pad {pad!r}; it has {known}")
        return self._sources[pad].pads["src"]

    # Called by the element.

    def elements(self) -> Sequence[Element]:
        """The element alone."""
        return (self.element,)

    def pad_added(self, pad: Pad) -> None:
        """Connects a new pad."""
        self._connect(pad)
        src = pad if pad.is_src else self._sources[pad.name].pads["src"]
        src.push = Chain(src).push

    def no_more_pads(self, element: Element) -> None:
        """Sets `has_all_pads`."""
        self.has_all_pads = True

    def reconfigure(self, element: Element) -> None:
        """Makes the next frame renegotiate."""
        for source in self._sources.values():
            source.pads["src"].caps = None

    def sink_ended(self, element: Element) -> None:
        """Sets `has_ended`."""
        self.has_ended = True
        super().sink_ended(element)

    def close(self) -> None:
        """Stops the element."""
        if self._open:
            self._open = False
            self.element.stopping.set()
            self.element.interrupt()
            self.element.stop()
            self.element.is_playing = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
