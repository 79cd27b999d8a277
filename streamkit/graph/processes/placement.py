"""Cuts a graph where a link leaves a bin with a process of its own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NoReturn

from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.element.pad_owner import walk
from streamkit.element.registry import is_registered
from streamkit.element.source import Source
from streamkit.errors import DescriptionError, Place
from streamkit.graph.bins import Bin, enclosing_bins
from streamkit.graph.graph import Graph, free_name
from streamkit.graph.processes.process_link import ProcessLink

FOR_PROCESSES = ("restart", "restart-window-s", "watchdog-s", "memory-mb", "sandbox", "shm-frames")
IN_MAIN = ("appsrc", "appsink")  # the application calls them


def cut(graph: Graph, places: dict[Element, Place]) -> None:
    """Assigns the elements to processes and puts a `ProcessLink` into every link between two of them.

    Args:
        graph: negotiated; `homes` and `process_links` are set, links are changed.
        places: in the text, of elements and bins.

    Raises:
        DescriptionError: an element or a link cannot be in the process that its bin asks for.
    """
    _assign(graph)
    if not graph.processes:
        return
    _check_elements(graph, places)
    _check_delayed_links(graph)
    for src, sink in list(graph.links()):
        writer, reader = graph.homes.get(src.element), graph.homes.get(sink.element)
        if writer is not reader:
            link = _insert(graph, src, sink)
            link.packages = graph.packages
            link.capacity = min(home.shm_frames for home in (writer, reader) if home is not None)
            link.renumbers = any(isinstance(element, Source) for element in _before(graph, src, writer))
            graph.process_links[link] = (writer, reader)
    graph.run_only(None)


def _check_elements(graph: Graph, places: dict[Element, Place]) -> None:
    """Refuses elements that cannot be in the process that they are assigned to."""

    def refuse(element: Element, rule: str, remedy: str) -> NoReturn:
        raise DescriptionError("could-not-set-property", rule, places.get(element), remedy)

    for element in graph.elements:
        if is_registered(element.factory):
            rule = f"{element.factory} is registered in this program, and no other process can import it"
            refuse(element, rule, "omit process=true, or put it into a package (streamkit new)")
    for element, home in graph.homes.items():
        if element.factory in IN_MAIN:
            rule = f"{element.name} is called by the application and cannot run in another process"
            refuse(element, rule, f"move it out of {home.name}")
        if home.restart and isinstance(element, Source) and not element.is_live:
            rule = f"{element.name} would start over when the process of {home.name} is started again"
            refuse(element, rule, "move it out of the bin, or omit restart")


def _check_delayed_links(graph: Graph) -> None:
    """Refuses links between processes that wait for a pad of the stream."""
    for delayed in graph.delayed_links:
        if graph.homes.get(delayed.request.source) is not graph.homes.get(delayed.request.sink):
            rule = f"{delayed.description} waits for a pad of the stream, and cannot lead to another process"
            remedy = "put both elements into one bin, with what follows them"
            raise DescriptionError("link", rule, delayed.request.place, remedy)


def _assign(graph: Graph) -> None:
    """Finds the innermost bin with a process for each element; a converter is in that of its source."""
    for group in graph.bins:
        home = next((outer for outer in (group, *enclosing_bins(group)) if outer.process), None)
        unused = [] if group.process else [name for name in group.set_in_text if name in FOR_PROCESSES]
        if unused:
            text = f"{group.name}: {', '.join(unused)} has no effect without process=true"
            graph.warnings.append(("no-effect", text))
        if home is not None:
            for child in group.children:
                if not isinstance(child, Bin):
                    graph.homes[child] = home
    for converter in graph.inserted:
        for source in converter.upstream():
            if source in graph.homes:
                graph.homes[converter] = graph.homes[source]


def _insert(graph: Graph, src: Pad, sink: Pad) -> ProcessLink:
    link = ProcessLink(free_name("processlink", {element.name for element in graph.elements}))
    src.unlink()
    src.link(link.pads["sink"])
    link.pads["src"].link(sink)
    graph.elements.insert(graph.elements.index(src.element) + 1, link)
    graph.inserted.append(link)
    return link


def _before(graph: Graph, src: Pad, home: Bin | None) -> Iterator[Element]:
    """The elements of a process from which frames come to a src pad of it."""

    def in_process(element: Element) -> list[Element]:
        return [other for other in element.upstream() if graph.homes.get(other) is home]

    return walk([src.element], in_process)
