"""funnel: merges several streams in order of arrival."""

from __future__ import annotations

import itertools

from typing_extensions import override

from streamkit.element.branching import Combine
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.flow.caps import ANY
from streamkit.flow.frame import Frame


class Funnel(Combine):
    """Forwards the frames of all inputs in order of arrival; ends when all inputs have ended.

    Example:
        funnel name=f ! fakesink  fakesrc num-buffers=3 ! f.  fakesrc num-buffers=5 ! f.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    forward_sticky_events: bool = Property(True, live=True, doc="Send the segment when the input changes.")

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Adds an input; its default name is `funnelpadN`, as in GStreamer."""
        names = (f"funnelpad{number}" for number in itertools.count())
        return super().request_pad(template, name or next(free for free in names if free not in self.pads))

    @override
    def combine(self, pad_name: str, frame: Frame) -> Frame:
        return frame

    def send_segment(self, pad: Pad) -> None:
        """Sends the input's segment if `forward-sticky-events` is on."""
        if self.forward_sticky_events:
            super().send_segment(pad)
