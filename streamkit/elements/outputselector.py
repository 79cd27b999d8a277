"""output-selector: to one of several branches."""

from __future__ import annotations

from collections.abc import Mapping

from streamkit.element.branching import Split
from streamkit.element.pad import Direction, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.flow.caps import ANY
from streamkit.flow.frame import Frame


class OutputSelector(Split):
    """Hands each frame to the active branch, the first at first; events go to every branch.

    Example:
        fakesrc num-buffers=3 ! output-selector name=s  s. ! fakesink  s. ! fakesink
    """

    sink = "ANY"
    templates = (PadTemplate("src_%u", Direction.SRC, ANY, Presence.REQUEST),)

    active_pad: str | None = Property(
        None, live=True, doc="Name of the branch that gets frames; unset is the first."
    )

    def split(self, frame: Frame) -> Mapping[str, Frame]:
        """The frame, for the active branch."""
        name = self.active_pad
        if name is None or name not in self.pads:
            name = next(pad.name for pad in self.src_pads())
        return {name: frame}
