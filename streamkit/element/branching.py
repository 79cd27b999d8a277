"""Combine and Split: elements with several sink pads or several src pads."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from streamkit.element.base import Element
from streamkit.element.negotiation import demand_accepted
from streamkit.element.pad import Pad, PadTemplate
from streamkit.errors import StreamkitError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import (
    EOS,
    CapsEvent,
    EosEvent,
    Event,
    FlushStart,
    FlushStop,
    GapEvent,
    SegmentEvent,
)
from streamkit.flow.frame import Frame
from streamkit.flow.signals import EndOfStream, FlowStop, NotLinked


class NumberedPads(Element):
    """Base of elements that may have thousands of request pads: numbers a new one without a look at all."""

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._next_numbers: dict[str, int] = {}
        super().__init__(name, **properties)

    def _next_name(self, template: PadTemplate) -> str:
        head, mark, tail = template.name.partition("%u")
        if not mark:
            return template.name
        number = self._next_numbers.get(template.name)
        name = super()._next_name(template) if number is None else f"{head}{number}{tail}"
        if name in self.pads:
            name = super()._next_name(template)
        if template.matches(name):
            self._next_numbers[template.name] = int(name[len(head) : len(name) - len(tail)]) + 1
        return name

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Makes a pad; one whose name is given may have the highest number."""
        made = super().request_pad(template, name)
        if name:
            self._next_numbers.pop(template.name, None)
        return made

    def release_pad(self, pad: Pad) -> None:
        """Takes a pad away; its number is free."""
        super().release_pad(pad)
        self._next_numbers.pop(pad.template.name, None)


class Combine(NumberedPads):
    """Base of n-to-1 elements: override `combine`. Frames of all pads come one at a time.

    When frames begin to come from another input, the caps and the segment of that input go before them.
    """

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._lock = threading.RLock()
        self._source: Pad | None = None
        self._has_ended = False
        super().__init__(name, **properties)

    def combine(self, pad_name: str, frame: Frame) -> Frame | Iterable[Frame] | None:
        """What to pass on when a frame arrives at the pad `pad_name`."""
        raise NotImplementedError

    def drain(self) -> Iterable[Frame]:
        """What is still held when every input has ended."""
        return ()

    def switched(self, pad: Pad) -> None:
        """Frames come from another input than before; its segment is to go before them."""
        if pad.segment != self.src_pad.segment:
            self.src_pad.send_event(SegmentEvent(pad.segment))

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
                if pad.is_eos:
                    raise EndOfStream(self.name)
                result = self.combine(name, frame)
                for out in (result,) if isinstance(result, Frame) else result or ():
                    self._push(out, pad)

        return receive

    def _push(self, frame: Frame, pad: Pad | None = None) -> None:
        """Sends a frame that came in at a pad on, after the events that must come before it."""
        src = self.src_pad
        if frame.caps is not src.caps or (pad is not None and pad is not self._source):
            self._lead_in(frame.caps, pad)
        src.push(frame)

    def _lead_in(self, caps: Caps | None, pad: Pad | None) -> None:
        """Sends the caps of what follows, and the segment of its input where that is another than before."""
        src = self.src_pad
        if caps is not None and caps is not src.caps:
            demand_accepted(src, caps)
            src.send_event(CapsEvent(caps))
        if pad is not None and pad is not self._source:
            self._source = pad
            self.switched(pad)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """EOS goes on when every input has ended; caps and segments go with the frames; the rest at once."""
        if isinstance(event, FlushStart | FlushStop):
            self.src_pad.send_event(event)
            return
        with self._lock:
            if isinstance(event, EosEvent):
                pad.is_eos = True
                self._end_if_all_have()
            elif isinstance(event, SegmentEvent):
                if pad is self._source:
                    self.switched(pad)
            elif not isinstance(event, CapsEvent):
                if isinstance(event, GapEvent):
                    self._lead_in(pad.caps, pad)
                self.src_pad.send_event(event)

    def _end_if_all_have(self) -> None:
        """Ends the stream, once, when no input can bring more."""
        sinks = list(self.sink_pads())
        if self._has_ended or not sinks or not all(sink.is_eos for sink in sinks):
            return
        self._has_ended = True
        with self.guarded():
            for frame in self.drain():
                self._push(frame)
        self.src_pad.send_event(EOS)

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Makes an input, also while others stream."""
        with self._lock:
            return super().request_pad(template, name)

    def release_pad(self, pad: Pad) -> None:
        """Takes an input away; if it was the last that had not ended, the stream ends."""
        with self._lock:
            super().release_pad(pad)
            self._end_if_all_have()

    def flush(self, *, begins: bool) -> None:
        """A flush lets inputs that have ended begin anew."""
        super().flush(begins=begins)
        if not begins:
            self._has_ended = False

    def pads_changed(self) -> None:
        """A run begins, or inputs have come or gone: the next frame's segment is sent anew."""
        self._source = None
        if not any(pad.is_eos for pad in self.sink_pads()):
            self._has_ended = False


class Split(NumberedPads):
    """Base of 1-to-n elements: override `split`."""

    def __init__(self, name: str = "", **properties: Any) -> None:
        self._branches: tuple[Pad, ...] = ()
        super().__init__(name, **properties)

    def split(self, frame: Frame) -> Mapping[str, Frame]:
        """The frame for each src pad that gets one, by pad name."""
        raise NotImplementedError

    def query_caps(self, pad: Pad) -> Caps:
        """The caps that all other pads have in common."""
        found = ANY
        for other in list(self.pads.values()):
            if other is not pad and other.peer is not None:
                found = found & other.template.caps & other.peer.query_caps()
        return found

    def remember_branches(self) -> None:
        """Notes what each src pad can carry, as `query_caps` answers, without asking all others for each."""
        if type(self).query_caps is not Split.query_caps:
            for pad in self.src_pads():
                pad.known_caps = pad.query_caps()
            return
        answers = {
            pad: pad.template.caps & pad.peer.query_caps()
            for pad in list(self.pads.values())
            if pad.peer is not None
        }
        counts = Counter(answers.values())
        met: dict[Caps | None, Caps] = {}
        for pad in self.src_pads():
            own = answers.get(pad)
            left_out = own if own is not None and counts[own] == 1 else None
            if left_out not in met:
                common = ANY
                for caps in counts:
                    common = common if caps is left_out else common & caps
                met[left_out] = common
            pad.known_caps = pad.template.caps & met[left_out]

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of the sink pad."""

        def receive(frame: Frame) -> None:
            for name, out in self.split(frame).items():
                target = self.pads.get(name)
                if target is None:
                    continue
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

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Makes a branch; before frames flow all are looked up at once."""
        made = super().request_pad(template, name)
        if self.host is not None:
            self.pads_changed()
        return made

    def release_pad(self, pad: Pad) -> None:
        """Takes a branch away; frames on their way reach it, later ones do not."""
        super().release_pad(pad)
        self.pads_changed()

    def pads_changed(self) -> None:
        """Branches have come or gone."""
        self._branches = tuple(pad for pad in list(self.pads.values()) if pad.is_src)
