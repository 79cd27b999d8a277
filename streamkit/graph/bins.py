"""Bins: named groups of elements in a description, and lookup of names in them."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence

from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.element.property import Property
from streamkit.element.property_text import UINT64
from streamkit.errors import DescriptionError, Place


class Bin(Element):
    """A group of elements in brackets; frames do not pass through it.

    Attributes:
        children: elements and bins, in textual order.
        ghost_pads: paths of inner pads that are linked from outside, by ghost pad name.
        ignored: properties without effect.
    """

    ignored = frozenset({"async_handling", "message_forward", "delay", "auto_flush_bus", "latency_ns"})

    process: bool = Property(False, doc="Run in a process of its own.")
    restart: int = Property(
        0, min=0, doc="How often in `restart-window-s` a process that dies or hangs is started again."
    )
    restart_window_s: float = Property(60.0, min=0.0, unit="s", doc="Earlier restarts are not counted.")
    watchdog_s: float = Property(
        0.0, min=0.0, unit="s", doc="Time limit of an element in it for a frame; 0 is the pipeline's."
    )
    memory_mb: int = Property(0, min=0, unit="MiB", doc="Private memory that the process may have; 0 is any.")
    sandbox: bool = Property(False, doc="Take rights from the process that it does not need.")
    shm_frames: int = Property(8, min=1, max=1024, doc="Frames on the way to or from the process.")
    async_handling: bool = Property(False, doc="Accepted for gst-launch's sake, without effect.")
    message_forward: bool = Property(False, doc="Accepted for gst-launch's sake, without effect.")

    def __init__(self, name: str = "bin", factory: str = "bin") -> None:
        super().__init__(name)
        self.factory = factory
        self.children: list[Element] = []
        self.ghost_pads: dict[str, str] = {}

    def child(self, name: str) -> Element | None:
        """The direct child of a name, or None."""
        return next((child for child in self.children if child.name == name), None)


class PipelineBin(Bin):
    """A group written as `pipeline.( ... )`."""

    delay: int = Property(0, min=0, max=UINT64, unit="ns", doc="Accepted for gst-launch's sake.")
    auto_flush_bus: bool = Property(True, doc="Accepted for gst-launch's sake.")
    latency_ns: int = Property(
        UINT64, name="latency", min=0, max=UINT64, unit="ns", doc="Accepted for gst-launch's sake."
    )


BIN_CLASSES: dict[str, type[Bin]] = {"bin": Bin, "pipeline": PipelineBin}


def search(children: Sequence[Element], name: str) -> Element | None:
    """The element or bin of a name; searches depth first, the last child first."""
    for child in reversed(children):
        if child.name == name:
            return child
        found = search(child.children, name) if isinstance(child, Bin) else None
        if found is not None:
            return found
    return None


def bin_of(element: Element) -> Bin | None:
    """The bin around an element or bin, or None."""
    return element.bin if isinstance(element.bin, Bin) else None


def enclosing_bins(element: Element) -> Iterator[Bin]:
    """The bins around an element or bin, from the inside out."""
    while (group := bin_of(element)) is not None:
        yield group
        element = group


class BinTree:
    """Assigns elements to bins while a graph is built.

    Attributes:
        root: elements and bins outside any bin, in textual order.
    """

    def __init__(self) -> None:
        self.root: list[Element] = []
        self._by_name: defaultdict[str, list[Element]] = defaultdict(list)
        self._names: defaultdict[Bin | None, set[str]] = defaultdict(set)
        self._duplicates: dict[Element, DescriptionError] = {}

    def add(self, element: Element, container: Bin | None, place: Place) -> None:
        """Adds an element or bin to a bin, or to none; records duplicate names as errors instead."""
        names = self._names[container]
        if element.name in names:
            scope = "pipeline" if container is None else "bin"
            what = f"two elements are named {element.name!r}; names are unique in a {scope}"
            self._duplicates[element] = DescriptionError("link", what, place)
            return
        names.add(element.name)
        self._by_name[element.name].append(element)
        element.bin = container
        (self.root if container is None else container.children).append(element)

    def remove(self, element: Element) -> None:
        """Undoes `add` for the element added last."""
        container = bin_of(element)
        self._names[container].discard(element.name)
        self._by_name[element.name].remove(element)
        (self.root if container is None else container.children).remove(element)

    def find(self, name: str) -> Element | None:
        """The element or bin of a reference, or None."""
        found = self._by_name.get(name, [])
        alone = self.root[0] if len(self.root) == 1 else None
        if isinstance(alone, Bin):
            return search(alone.children, name)
        return found[0] if len(found) == 1 else search(self.root, name)

    def check_unique(self, element: Element) -> None:
        """Raises a `DescriptionError` (code `link`) if the element's name is a duplicate in its bin."""
        if element in self._duplicates:
            raise self._duplicates[element]

    def check_all_unique(self) -> None:
        """Raises the first `DescriptionError` for a duplicate name, if any."""
        for error in self._duplicates.values():
            raise error

    def add_ghost_pads(self, links: Iterable[tuple[Pad, Pad]]) -> None:
        """Adds a ghost pad to every bin whose border a link crosses, numbered in the order of the links."""
        numbers = itertools.count()
        for src, sink in links:
            outer, inner = list(enclosing_bins(src.element)), list(enclosing_bins(sink.element))
            for pad, chain, others in ((src, outer, inner), (sink, inner, outer)):
                reached = pad.path
                for group in chain:
                    if group in others:
                        break
                    name = f"ghost{next(numbers)}"
                    group.ghost_pads[name] = reached
                    reached = f"{group.name}.{name}"
