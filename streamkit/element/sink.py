"""Sink: an element that frames end in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from streamkit.element.base import Element
from streamkit.element.negotiation import refusal
from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.errors import ElementFailure, NotNegotiated
from streamkit.flow.caps import Caps
from streamkit.flow.events import CapsEvent, EosEvent, Event
from streamkit.flow.frame import Frame
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.signals import FlowStop, Flushing


class Sink(Element):
    """Base of sinks: override `render`, and `drain` for what is left to do at EOS."""

    sync: bool = Property(False, doc="Wait until each frame's time has come, on the pipeline's clock.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._zero: tuple[int, int] | None = None
        super().__init__(name, **properties)

    # What an author overrides.

    def render(self, frame: Frame) -> None:
        """Takes one frame."""
        raise NotImplementedError

    def drain(self) -> None:
        """EOS: everything that came is to be finished."""

    def configure(self, sink_caps: Caps) -> None:
        """New caps: frames that follow have them."""

    # What the engine calls.

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of a pad."""
        self._zero = None
        return self._render_in_time if self.sync else self.render

    def _render_in_time(self, frame: Frame) -> None:
        if frame.pts is not None:
            if self._zero is None or self._zero[1] != frame.epoch:
                self._zero = (self.clock_ns() - frame.pts, frame.epoch)
            if not self.clock.wait_until(self._zero[0] + frame.pts, self.stopping):
                raise Flushing(self.name)
        self.render(frame)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Takes caps and EOS; EOS is told to the pipeline once everything is drained."""
        try:
            if isinstance(event, CapsEvent):
                if (event.caps & pad.template.caps & self.query_caps(pad)).is_empty and pad.peer is not None:
                    raise refusal(pad.peer, event.caps, pad.template.caps & self.query_caps(pad))
                self.configure(event.caps)
            elif isinstance(event, EosEvent) and not pad.is_eos:
                self.drain()
                pad.is_eos = True
                self.post(Message(MessageKind.EOS, self.name))
        except (FlowStop, ElementFailure, NotNegotiated):
            raise
        except Exception as cause:
            raise self.failure(cause) from cause
