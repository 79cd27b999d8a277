"""Host: what a running graph does for the elements in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.element.pad import Pad


class Host(Protocol):
    """The running graph, as an element sees it."""

    def pad_added(self, pad: Pad) -> None:
        """A pad has come into being while the graph streams: links that wait for it are tried."""

    def no_more_pads(self, element: Element) -> None:
        """The element has all the pads its stream gives: links still waiting for one are reported."""

    def reconfigure(self, element: Element) -> None:
        """What the element can take has changed: caps are negotiated anew before the next frame."""

    def sink_ended(self, element: Element) -> None:
        """A sink has finished all that came before EOS."""

    def prerolled(self, element: Element) -> None:
        """A sink of the paused graph holds its first frame."""
