"""Transform: an element that maps each frame to none, one or several."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from typing import Any, ClassVar, TypeVar

from typing_extensions import override

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad
from streamkit.flow.caps import Caps
from streamkit.flow.events import CapsEvent, EndOfStream, EosEvent, Event
from streamkit.flow.frame import Frame
from streamkit.flow.video import check_output

T = TypeVar("T")
Result = Frame | Iterable[Frame | tuple[str, Frame]] | None


class Transform(Element):
    """Base class of elements with one sink pad: override `transform`, and `drain` if frames are held back.

    Frames leave through the pad `src`. For further src pads, declared in `templates`, `transform` yields
    pairs of pad name and frame; their caps are sent before the first frame that has them. Every other event
    reaches every src pad.

    Attributes:
        keeps_caps: whether its output has the caps of its input.
    """

    keeps_caps: ClassVar[bool] = False

    # Overridden by authors.

    def transform(self, frame: Frame) -> Result:
        """Returns a frame, several, or None; of several, `(pad name, frame)` leaves through that pad."""
        raise NotImplementedError(f"{type(self).__name__} does not define transform")

    def drain(self) -> Iterable[Frame | tuple[str, Frame]]:
        """Frames still held at EOS."""
        return ()

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        """New caps for the frames that follow."""

    def event(self, event: Event) -> None:
        """An event arrived, in order with the frames."""

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """Caps of the other pad while the `direction` ("sink" or "src") pad carries `caps`."""
        if self.keeps_caps:
            return caps
        other = Direction.SRC if direction == Direction.SINK else Direction.SINK
        return self.pads[str(other)].template.caps

    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps | None:
        """Chooses the output caps out of `allowed`; None if only the first frame can tell."""
        return sink_caps if self.keeps_caps else allowed.fixate(near=sink_caps)

    def is_passthrough(self) -> bool:
        """Whether frames bypass the element with the current properties, at no cost."""
        return False

    # Called by the engine.

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.keeps_caps = str(cls.sink) == str(cls.src) and cls.transform_caps is Transform.transform_caps

    def __init__(self, name: str = "", **properties: Any) -> None:
        super().__init__(name, **properties)
        if not {"sink", "src"} <= self.pads.keys():
            raise TypeError(
                f'{type(self).__name__} declares no pads: write sink = src = "video/x-raw" in the class'
            )

    @override
    def query_caps(self, pad: Pad) -> Caps:
        if pad.is_src and pad is not self.src_pad:
            return pad.template.caps
        other = self.pads["sink" if pad.is_src else "src"]
        beyond = other.peer_caps() & other.template.caps
        return self.transform_caps(beyond, str(other.template.direction))

    @override
    def receive_event(self, pad: Pad, event: Event) -> tuple[Pad, Event] | None:
        with self.guarded():
            if isinstance(event, CapsEvent):
                src_caps = self._negotiate(event.caps)
                return None if src_caps is None else (self.src_pad, CapsEvent(src_caps))
            if isinstance(event, EosEvent):
                if not self.has_failed:
                    self._drain()
            else:
                self.event(event)
        for side_pad in self.side_pads():
            side_pad.send_event(event)
        return self.src_pad, event

    def _drain(self) -> None:
        # If downstream wants no more of them, EOS follows all the same: other threads behind wait for it.
        with self.calling("drain"), contextlib.suppress(EndOfStream):
            for item in drained_frames(self.drain()):
                self.push_output(*(item if isinstance(item, tuple) else ("src", item)))

    def side_pads(self) -> list[Pad]:
        """Linked src pads other than `src`."""
        main = self.src_pad
        return [pad for pad in self.src_pads() if pad is not main and pad.peer is not None]

    def push_output(self, name: str, frame: Frame) -> None:
        """Sends a frame through the src pad of a name, after its caps if they are new.

        A frame for another pad than `src` is lost if that is not linked or its branch has ended.

        Raises:
            StateError: the element declares no such pad.
            ValueError: the frame is not what its caps say.
        """
        check_output(frame, "drain")
        pad = self.pads.get(name)
        if pad is self.src_pad:
            pad.push(self.announce_src_caps(frame))
            return
        if pad is None or pad.peer is None:
            self.check_declares_src(name)
            return
        frame = pad.announce_caps(frame)
        with contextlib.suppress(EndOfStream):
            pad.push(frame)

    def _negotiate(self, sink_caps: Caps) -> Caps | None:
        """Configures the element; returns the output caps, or None if only a frame can tell."""
        sink, src = self.pads["sink"], self.src_pad
        if not sink_caps.can_intersect(sink.template.caps) and sink.peer is not None:
            raise sink.peer.refusal(sink_caps, sink.template.caps)
        possible = self.transform_caps(sink_caps, "sink")
        if possible.is_empty and sink.peer is not None:
            raise sink.peer.refusal(sink_caps, sink.query_caps())
        allowed = src.allowed_caps(possible)
        src_caps = self.fixate(sink_caps, allowed)
        if src_caps is None:
            src.caps = None
            return None
        if src_caps == sink_caps:
            src_caps = sink_caps
        self._configure(sink_caps, src_caps)
        return src_caps

    def _configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        self.src_pad.caps = src_caps
        with self.guarded():
            self.configure(sink_caps, src_caps)

    def announce_src_caps(self, frame: Frame) -> Frame:
        """Sends the caps of an output frame if they changed; returns the frame with the src pad's caps."""
        pad = self.pads["src"]
        caps = frame.caps
        if caps is pad.caps:
            return frame
        if pad.caps is not None and (caps is self.pads["sink"].caps or caps == pad.caps):
            return frame.replace(caps=pad.caps)
        pad.check_accepted(caps)
        self._configure(self.pads["sink"].caps or caps, caps)
        pad.send_event(CapsEvent(caps))
        return frame


def drained_frames(drained: Iterable[T] | None) -> Iterable[T]:
    """What `drain` has returned, where None is none; raises `TypeError` where that is one frame."""
    if isinstance(drained, Frame):
        raise TypeError("drain returns several frames, got one Frame: write yield frame")
    return () if drained is None else drained
