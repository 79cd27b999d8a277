"""capsfilter: lets one kind of frames through; written as caps between two `!`."""

from __future__ import annotations

from streamkit.element.property import Property
from streamkit.element.transform import Transform
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.frame import Frame


class CapsFilter(Transform):
    """Restricts the caps on a link.

    Example:
        videotestsrc num-buffers=5 ! video/x-raw, format=GRAY8, width=320 ! fakesink
    """

    sink = src = "ANY"

    caps: Caps = Property(ANY, live=True, doc="What may pass; when it changes upstream negotiates anew.")

    def property_changed(self, name: str) -> None:
        """New caps: upstream is to follow."""
        self.reconfigure()

    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        """The caps of the other pad: the same, within the filter; the filter's order rules."""
        return self.caps & caps

    def is_passthrough(self) -> bool:
        """Frames pass unseen: negotiation has seen to their caps."""
        return True

    def transform(self, frame: Frame) -> Frame:
        """The same frame."""
        return frame
