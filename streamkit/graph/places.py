"""Where elements stand: in which bin, under which name, and what a link between bins crosses."""

from __future__ import annotations

from collections import defaultdict

from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.errors import DescriptionError, Place
from streamkit.graph.bins import Bin, containers, search


class Placement:
    """Keeps the bins of a graph and what stands in them.

    Attributes:
        root: what stands in no bin, in the order it came.
    """

    def __init__(self) -> None:
        self.root: list[Element] = []
        self._containers: dict[int, Bin | None] = {}
        self._by_name: defaultdict[str, list[Element]] = defaultdict(list)
        self._names: defaultdict[int, set[str]] = defaultdict(set)
        self._doubles: dict[int, DescriptionError] = {}
        self._crossings: dict[int, list[tuple[Bin, str]]] = {}
        self._ghost_number = 0

    def place(self, element: Element, container: Bin | None, place: Place) -> None:
        """Puts an element or bin into a bin, or into none; a second of one name stays out, and is noted."""
        names = self._names[id(container)]
        if element.name in names:
            what = f"two elements are named {element.name!r}; names are unique in a pipeline"
            if container is not None:
                what = f"two elements are named {element.name!r}; names are unique in a bin"
            self._doubles[id(element)] = DescriptionError("link", what, place)
            return
        names.add(element.name)
        self._by_name[element.name].append(element)
        self._containers[id(element)] = container
        (self.root if container is None else container.children).append(element)
        element.parent = "" if container is None else container.name
        if isinstance(element, Bin):
            element.container = container

    def take_out(self, element: Element) -> None:
        """Undoes `place` for the element that came last."""
        container = self._containers.pop(id(element))
        self._names[id(container)].discard(element.name)
        self._by_name[element.name].remove(element)
        (self.root if container is None else container.children).remove(element)

    def container_of(self, element: Element) -> Bin | None:
        """The bin that an element stands in."""
        return self._containers.get(id(element))

    def find(self, name: str) -> Element | None:
        """The element or bin that a reference means."""
        found = self._by_name.get(name, [])
        alone = self.root[0] if len(self.root) == 1 else None
        if isinstance(alone, Bin):
            return search(alone.children, name)
        return found[0] if len(found) == 1 else search(self.root, name)

    def demand_placed(self, element: Element) -> None:
        """Refuses an element whose name another of its bin has.

        Raises:
            DescriptionError: code `link`.
        """
        if id(element) in self._doubles:
            raise self._doubles[id(element)]

    def demand_all_placed(self) -> None:
        """Refuses a graph in which two elements of a bin have one name.

        Raises:
            DescriptionError: code `link`.
        """
        for error in self._doubles.values():
            raise error

    def cross(self, src: Pad, sink: Pad) -> None:
        """Notes a ghost pad on every bin whose edge a link crosses."""
        source, target = self.container_of(src.element), self.container_of(sink.element)
        if source is target:
            return
        self._crossings[id(src)] = []
        outer, inner = list(containers(source)), list(containers(target))
        common = {id(group) for group in outer} & {id(group) for group in inner}
        for pad, chain in ((src, outer), (sink, inner)):
            reached = pad.path
            for group in chain:
                if id(group) in common:
                    break
                name = f"ghost{self._ghost_number}"
                self._ghost_number += 1
                group.ghost_pads[name] = reached
                self._crossings[id(src)].append((group, name))
                reached = f"{group.name}.{name}"

    def uncross(self, src: Pad) -> None:
        """Undoes `cross` for a link that is taken back; the numbers of its ghost pads are used up."""
        for group, name in self._crossings.pop(id(src), ()):
            del group.ghost_pads[name]
