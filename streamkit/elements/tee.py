"""tee: the same frames to several branches."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from streamkit.element.branching import Split
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.flow.caps import ANY
from streamkit.flow.frame import Frame
from streamkit.flow.signals import EndOfStream, NotLinked


class Tee(Split):
    """Hands every frame to each of its branches, shared and not copied; put a queue into each branch.

    Example:
        fakesrc num-buffers=3 ! tee name=t  t. ! queue ! fakesink  t. ! queue ! fakesink
    """

    sink = "ANY"
    templates = (PadTemplate("src_%u", Direction.SRC, ANY, Presence.REQUEST),)

    allow_not_linked: bool = Property(False, live=True, doc="Go on where no branch is linked.")

    def split(self, frame: Frame) -> Mapping[str, Frame]:
        """The frame, for every branch."""
        return dict.fromkeys((pad.name for pad in self.src_pads()), frame)

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of the sink pad."""
        ended: set[str] = set()

        def receive(frame: Frame) -> None:
            taken = 0
            for src in tuple(self.pads.values()):
                if src is pad or src.name in ended:
                    continue
                try:
                    src.push(frame)
                    taken += 1
                except NotLinked:
                    self.count_drop("branch not linked")
                except EndOfStream:
                    ended.add(src.name)
            if not taken:
                if ended:
                    raise EndOfStream(self.name)
                if not self.allow_not_linked:
                    raise NotLinked(f"{self.name}.src_%u")

        return receive
