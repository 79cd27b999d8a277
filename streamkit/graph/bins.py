"""Bins: named groups of elements in a description, and how names in them are found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from streamkit.element.base import Element
from streamkit.element.property import Property


class Bin(Element):
    """A group of elements, written in brackets; it moves no frames itself.

    Attributes:
        parent: name of the bin it stands in, or "".
        container: that bin, or None.
        children: what stands in it, in the order it came.
        ghost_pads: pads of what stands in it that links from outside go to, by the name they have here.
    """

    async_handling: bool = Property(
        False, doc="Accepted for gst-launch's sake; state changes are handled for the whole pipeline."
    )
    message_forward: bool = Property(
        False, doc="Accepted for gst-launch's sake; every message reaches the pipeline's bus."
    )

    def __init__(self, name: str = "bin", factory: str = "bin", parent: str = "") -> None:
        super().__init__(name)
        self.factory = factory
        self.parent = parent
        self.container: Bin | None = None
        self.children: list[Element] = []
        self.ghost_pads: dict[str, str] = {}

    def child(self, name: str) -> Element | None:
        """What stands directly in it under a name."""
        return next((child for child in self.children if child.name == name), None)


class PipelineBin(Bin):
    """A group that was written `pipeline.( ... )`."""

    delay: int = Property(0, min=0, max=2**64 - 1, unit="ns", doc="Accepted for gst-launch's sake.")
    auto_flush_bus: bool = Property(True, doc="Accepted for gst-launch's sake.")
    latency_ns: int = Property(
        2**64 - 1, name="latency", min=0, max=2**64 - 1, unit="ns", doc="Accepted for gst-launch's sake."
    )


BIN_CLASSES: dict[str, type[Bin]] = {"bin": Bin, "pipeline": PipelineBin}


def search(children: Sequence[Element], name: str) -> Element | None:
    """The element or bin of a name: what came last is looked at first, and into each bin at once."""
    for child in reversed(children):
        if child.name == name:
            return child
        found = search(child.children, name) if isinstance(child, Bin) else None
        if found is not None:
            return found
    return None


def containers(container: Bin | None) -> Iterator[Bin]:
    """A bin and all that it stands in, from the inside out."""
    while container is not None:
        yield container
        container = container.container
