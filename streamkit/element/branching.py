"""Combine and Split: elements with several sink pads or several src pads."""

from __future__ import annotations

import itertools
import operator
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from typing_extensions import override

from streamkit.element.base import NO_HOST, Element
from streamkit.element.pad import Pad, PadTemplate
from streamkit.element.transform import drained_frames
from streamkit.errors import PropertyError, StreamkitError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import (
    EOS,
    CapsEvent,
    EndOfStream,
    EosEvent,
    Event,
    FlowStop,
    FlushEvent,
    GapEvent,
    NotLinked,
    SegmentEvent,
)
from streamkit.flow.frame import Frame
from streamkit.flow.video import check_output


class Combine(Element):
    """Base class of n-to-1 elements: override `combine`, which gets the frames of all inputs one at a time.

    When the input changes, its caps and segment are sent before its frames. Frames are pushed downstream with
    `combine_lock` held; `Element.lock` stays free, so that `interrupt` does not wait for downstream.
    """

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.combine_lock = threading.RLock()
        self._last_input: Pad | None = None
        super().__init__(name, **properties)

    def combine(self, pad_name: str, frame: Frame) -> Frame | Iterable[Frame] | None:
        """The output for a frame of the pad `pad_name`."""
        raise NotImplementedError

    def drain(self) -> Iterable[Frame]:
        """Frames still held when every input has ended."""
        return ()

    def send_segment(self, pad: Pad) -> None:
        """Sends the segment of an input, if it is another than the last one sent."""
        if pad.segment != self.src_pad.segment:
            self.src_pad.send_event(SegmentEvent(pad.segment))

    def query_caps(self, pad: Pad) -> Caps:
        """Inputs can carry what the output can; the output what any input can."""
        if not pad.is_src:
            return self.src_pad.peer_caps()
        found = Caps()
        for sink in self.sink_pads():
            found = found | (sink.peer.query_caps() if sink.peer is not None else ANY)
        return found if found else ANY

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        name = pad.name

        def receive(frame: Frame) -> None:
            with self.combine_lock:
                if pad.is_eos:
                    raise EndOfStream(self.name)
                result = self.combine(name, frame)
                for out in (result,) if isinstance(result, Frame) else () if result is None else result:
                    self.push_output(out, pad)

        return receive

    def push_output(self, frame: Frame, pad: Pad | None = None) -> None:
        """Sends a frame of an input, after the events that precede it."""
        check_output(frame, "combine")
        self._send_caps_and_segment(frame.caps, pad)
        self.src_pad.push(frame)

    def _send_caps_and_segment(self, caps: Caps | None, pad: Pad | None) -> None:
        """Sends caps if they are new, and the segment if the input has changed."""
        src = self.src_pad
        if caps is not None and caps is not src.caps:
            src.check_accepted(caps)
            src.send_event(CapsEvent(caps))
        if pad is not None and pad is not self._last_input:
            self._last_input = pad
            self.send_segment(pad)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Forwards EOS and the end of a flush after the last input's, the rest in order or at once."""
        if isinstance(event, FlushEvent):
            if event.begins or not self.is_flushing:
                self.src_pad.send_event(event)
            return
        with self.combine_lock:
            if isinstance(event, EosEvent):
                pad.is_eos = True
                self._send_eos_if_all_ended()
            elif isinstance(event, SegmentEvent):
                if pad is self._last_input:
                    self.send_segment(pad)
            elif not isinstance(event, CapsEvent):
                self._forward_event(pad, event)

    def _forward_event(self, pad: Pad, event: Event) -> None:
        """Forwards any other event."""
        if isinstance(event, GapEvent):
            self._send_caps_and_segment(pad.caps, pad)
        self.src_pad.send_event(event)

    def _send_eos_if_all_ended(self) -> None:
        """Ends the stream, once, when every input has ended."""
        sinks = list(self.sink_pads())
        if self.src_pad.is_eos or not sinks or not all(sink.is_eos for sink in sinks):
            return
        if not self.has_failed:
            with self.guarded():
                for frame in drained_frames(self.drain()):
                    self.push_output(frame)
        self.src_pad.send_event(EOS)

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Adds an input, also while others stream."""
        with self.combine_lock:
            return super().request_pad(template, name)

    def release_pad(self, pad: Pad) -> None:
        """Removes an input; the stream ends if all others have ended."""
        with self.combine_lock:
            super().release_pad(pad)
            self._send_eos_if_all_ended()

    def pads_changed(self) -> None:
        """Sends the segment again before the next frame."""
        self._last_input = None
        if not any(pad.is_eos for pad in self.sink_pads()):
            self.src_pad.is_eos = False


class Split(Element):
    """Base class of 1-to-n elements: override `split`."""

    def split(self, frame: Frame) -> Mapping[str, Frame]:
        """Frames by the name of the src pad that they leave through."""
        raise NotImplementedError

    def query_caps(self, pad: Pad) -> Caps:
        """Caps that all other pads accept; a branch that has not joined may still get a converter."""
        found = ANY
        for other in list(self.pads.values()):
            if other is not pad and other.peer is not None and not other.awaits_first_frame:
                found = found & other.template.caps & other.peer.query_caps()
        return found

    def cache_branch_caps(self) -> None:
        """Caches `query_caps` of every src pad, in linear time."""
        if type(self).query_caps is not Split.query_caps:
            for pad in self.src_pads():
                pad.known_caps = pad.query_caps()
            return
        linked = [pad for pad in list(self.pads.values()) if pad.peer is not None]
        answers = [pad.template.caps & pad.peer_caps() for pad in linked]
        # Of each pad all others: the intersection of those before it with that of those after it.
        before = list(itertools.accumulate(answers, operator.and_, initial=ANY))
        after = list(itertools.accumulate(reversed(answers), lambda later, own: own & later, initial=ANY))
        after.reverse()
        for index, pad in enumerate(linked):
            if pad.is_src:
                pad.known_caps = before[index] & after[index + 1] & pad.template.caps

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        def receive(frame: Frame) -> None:
            outputs = self.split(frame)
            if not isinstance(outputs, Mapping):
                raise TypeError(
                    f"split returns frames by the name of their pad, got {type(outputs).__name__}: "
                    'write {"PAD": frame}, or {} for none'
                )
            for name, out in outputs.items():
                target = self.pads.get(name)
                if target is None:
                    self.check_declares_src(name)
                    continue
                check_output(out, "split")
                target.push(target.announce_caps(out))

        return receive

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Sends every event to every src pad, also if one of them fails."""
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

    @override
    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        made = super().request_pad(template, name)
        self.pads_changed()
        return made

    def release_pad(self, pad: Pad) -> None:
        """Removes a branch; later frames do not reach it."""
        super().release_pad(pad)
        self.pads_changed()


def check_active_pad(element: Element, name: str | None, template_name: str) -> None:
    """Refuses a name that is not a pad; while the graph is built, one that cannot become a pad.

    Raises:
        PropertyError: with the names of the pads.
    """
    template = element.pad_templates[template_name]
    if name is None or name in element.pads or (element.host is NO_HOST and template.matches(name)):
        return
    known = ", ".join(pad for pad in element.pads if template.matches(pad))
    known = known or template_name.replace("%u", "0, ...")
    raise PropertyError(
        f"{element.name}: property active-pad cannot be {name!r}: it takes the name of a pad ({known})"
    )
