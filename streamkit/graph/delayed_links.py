"""Links that wait for a pad which only the stream brings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad
from streamkit.errors import DescriptionError
from streamkit.graph.link import Ends

MakeLink = Callable[[Ends], list[tuple[Pad, Pad]]]


@dataclass(slots=True)
class DelayedLink:
    """A link that is tried again whenever its source has got a new pad.

    Attributes:
        ends: the two elements and the pads named.
        make: makes one link between two ends, with its filter if it has one.
        every_pad: whether it links every pad that comes and so never is complete.
        has_succeeded: whether it has linked a pad.
    """

    ends: Ends
    make: MakeLink
    every_pad: bool = False
    has_succeeded: bool = False

    @property
    def source(self) -> Element:
        """The element whose pad is waited for."""
        return self.ends.source

    @property
    def description(self) -> str:
        """What is to be linked, for people."""
        ends = self.ends
        src = f"{ends.source.name}.{ends.src_name}"
        return f"{src} ! {ends.sink.name}{'.' if ends.sink_name else ''}{ends.sink_name}"

    def try_link(self, element: Element, pad: Pad) -> list[tuple[Pad, Pad]]:
        """Links a pad that has come, if it is the one waited for; the links made."""
        if element is not self.ends.source or pad.template.direction is not Direction.SRC:
            return []
        if pad.peer is not None or (self.has_succeeded and not self.every_pad):
            return []
        if self.ends.src_name not in ("", pad.name, pad.template.name):
            return []
        try:
            made = self.make(self.ends._replace(src_name=pad.name))
        except DescriptionError:
            return []
        self.has_succeeded = True
        return made
