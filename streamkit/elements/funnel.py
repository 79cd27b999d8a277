"""funnel: several streams into one, as the frames come."""

from __future__ import annotations

from streamkit.element.branching import Combine
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.flow.caps import ANY
from streamkit.flow.frame import Frame


class Funnel(Combine):
    """Passes on the frames of all its inputs in the order they arrive; ends when all inputs have ended.

    Example:
        funnel name=f ! fakesink  fakesrc num-buffers=3 ! f.  fakesrc num-buffers=5 ! f.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    forward_sticky_events: bool = Property(
        True, live=True, doc="Send the segment of an input before its frames whenever the input changes."
    )

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """An input; one that is not named is called `funnelpadN`, as GStreamer has it."""
        if not name:
            number = 0
            while f"funnelpad{number}" in self.pads:
                number += 1
            name = f"funnelpad{number}"
        return super().request_pad(template, name)

    def combine(self, pad_name: str, frame: Frame) -> Frame:
        """The frame, whichever input it came from."""
        return frame

    def switched(self, pad: Pad) -> None:
        """Sends the input's segment, unless the property says not to."""
        if self.forward_sticky_events:
            super().switched(pad)
