"""funnel: several streams into one, as the frames come."""

from __future__ import annotations

from streamkit.element.branching import Combine
from streamkit.element.pad import Direction, PadTemplate, Presence
from streamkit.flow.caps import ANY
from streamkit.flow.frame import Frame


class Funnel(Combine):
    """Passes on the frames of all its inputs in the order they arrive; ends when all inputs have ended.

    Example:
        funnel name=f ! fakesink  fakesrc num-buffers=3 ! f.  fakesrc num-buffers=5 ! f.
    """

    src = "ANY"
    templates = (PadTemplate("sink_%u", Direction.SINK, ANY, Presence.REQUEST),)

    def combine(self, pad_name: str, frame: Frame) -> Frame:
        """The frame, whichever input it came from."""
        return frame
