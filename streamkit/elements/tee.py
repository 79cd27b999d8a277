"""tee: sends the same frames to several branches."""

from __future__ import annotations

from collections.abc import Callable

from typing_extensions import override

from streamkit.element.branching import Split
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.element.property import Property
from streamkit.flow.caps import ANY
from streamkit.flow.events import NotLinked
from streamkit.flow.frame import Frame


class Tee(Split):
    """Sends every frame to each branch, without a copy; put a queue into each branch.

    A branch that ends or fails ends the tee's stream, unless its sinks have `on-error=drop-branch`. Unlinked
    branches matter only if all are unlinked.

    Example:
        fakesrc num-buffers=3 ! tee name=t  t. ! queue ! fakesink  t. ! queue ! fakesink
    """

    sink = "ANY"
    templates = (PadTemplate("src_%u", Direction.SRC, ANY, Presence.REQUEST),)

    allow_not_linked: bool = Property(False, live=True, doc="Continue if no branch is linked.")
    num_src_pads: int = Property(0, read=lambda t: sum(1 for _ in t.src_pads()), doc="Number of branches.")
    silent: bool = Property(True, live=True, doc="Keep no text in last-message.")
    last_message: str | None = Property(None, readonly=True, doc="The last action.")

    _branches: tuple[Pad, ...] = ()

    @override
    def pads_changed(self) -> None:
        self._branches = tuple(self.src_pads())

    @override
    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        self.pads_changed()

        def receive(frame: Frame) -> None:
            not_linked = 0
            branches = self._branches
            for branch in branches:
                try:
                    branch.push(frame)
                except NotLinked:
                    not_linked += 1
            if not_linked:
                self.count_drop("branch not linked", not_linked)
            if not_linked == len(branches) and not self.allow_not_linked:
                raise NotLinked(f"{self.name}.src_%u")
            if not self.silent:
                self.last_message = f"chain ({pad.path}) {frame.describe()}"

        return receive
