"""Combine and Split: elements with several sink pads or several src pads."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from streamkit.element.base import Element
from streamkit.element.negotiation import demand_accepted
from streamkit.element.pad import Pad
from streamkit.errors import ElementFailure, NotNegotiated, StreamkitError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import EOS, CapsEvent, EosEvent, Event
from streamkit.flow.frame import Frame
from streamkit.flow.signals import FlowStop, NotLinked


class Combine(Element):
    """Base of n-to-1 elements: override `combine`. Frames of all pads come one at a time."""

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._lock = threading.RLock()
        super().__init__(name, **properties)

    def combine(self, pad_name: str, frame: Frame) -> Frame | Iterable[Frame] | None:
        """What to pass on when a frame arrives at the pad `pad_name`."""
        raise NotImplementedError

    def drain(self) -> Iterable[Frame]:
        """What is still held when every input has ended."""
        return ()

    @property
    def src_pad(self) -> Pad:
        """The src pad."""
        return next(self.src_pads())

    def query_caps(self, pad: Pad) -> Caps:
        """Every input carries what the output can, and the output what any input can."""
        if not pad.is_src:
            return self.src_pad.peer_caps()
        found = Caps()
        for sink in self.sink_pads():
            found = found | (sink.peer.query_caps() if sink.peer is not None else ANY)
        return found if found else ANY

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of a pad."""
        name = pad.name

        def receive(frame: Frame) -> None:
            with self._lock:
                result = self.combine(name, frame)
                for out in (result,) if isinstance(result, Frame) else result or ():
                    self._push(out)

        return receive

    def _push(self, frame: Frame) -> None:
        src = self.src_pad
        if frame.caps is not src.caps:
            demand_accepted(src, frame.caps)
            src.send_event(CapsEvent(frame.caps))
        src.push(frame)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """EOS goes on when every input has ended; caps follow the frames; the rest goes on at once."""
        with self._lock:
            if isinstance(event, EosEvent):
                pad.is_eos = True
                if all(sink.is_eos for sink in self.sink_pads()):
                    self._drain()
                    self.src_pad.send_event(EOS)
            elif not isinstance(event, CapsEvent):
                self.src_pad.send_event(event)

    def _drain(self) -> None:
        try:
            for frame in self.drain():
                self._push(frame)
        except (FlowStop, ElementFailure, NotNegotiated):
            raise
        except Exception as cause:
            raise self.failure(cause) from cause


class Split(Element):
    """Base of 1-to-n elements: override `split`."""

    def split(self, frame: Frame) -> Mapping[str, Frame]:
        """The frame for each src pad that gets one, by pad name."""
        raise NotImplementedError

    def query_caps(self, pad: Pad) -> Caps:
        """The caps that all other pads have in common."""
        found = ANY
        for other in self.pads.values():
            if other is not pad and other.peer is not None:
                found = found & other.template.caps & other.peer.query_caps()
        return found

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of the sink pad."""

        def receive(frame: Frame) -> None:
            for name, out in self.split(frame).items():
                target = self.pads[name]
                if out.caps is not target.caps:
                    target.send_event(CapsEvent(out.caps))
                target.push(out)

        return receive

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Every event goes to every src pad; one that fails does not keep the others from theirs."""
        stop: Exception | None = None
        for src in list(self.src_pads()):
            try:
                src.send_event(event)
            except StreamkitError as error:
                stop = error
            except FlowStop as end:
                stop = stop or end
        if stop is not None and not isinstance(stop, NotLinked):
            raise stop
