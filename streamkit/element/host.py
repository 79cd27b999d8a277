"""Host: the running graph, as its elements see it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.element.pad import Pad
    from streamkit.flow.statistics import ElementStatistics


class Host(Protocol):
    """The running graph, as elements see it."""

    @property
    def error(self) -> Exception | None:
        """The failure that has ended the run, or None."""

    def elements(self) -> Sequence[Element]:
        """All elements of the graph, in textual order."""

    def statistics(self, now_ns: int) -> Sequence[ElementStatistics]:
        """Counters of the elements, in textual order; those in other processes have none."""

    def pad_added(self, pad: Pad) -> None:
        """Tries the delayed links of a pad that was added while the graph streams."""

    def no_more_pads(self, element: Element) -> None:
        """Reports delayed links of an element that adds no more pads."""

    def reconfigure(self, element: Element) -> None:
        """Renegotiates upstream of an element whose accepted caps have changed."""

    def sink_ended(self, element: Element) -> None:
        """A sink has drained after EOS."""

    def prerolled(self, element: Element) -> None:
        """A sink of the paused graph holds its first frame."""
