"""Negotiation before streaming: checks the caps of all links, and inserts converters for raw video."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from streamkit.element.branching import Split
from streamkit.element.pad import Pad
from streamkit.element.registry import available_elements, located, make_element
from streamkit.errors import DescriptionError, Place
from streamkit.flow.caps import Caps
from streamkit.graph.graph import Graph, free_name
from streamkit.graph.link import are_convertible, caps_conflict

CONVERTER = "videoconvert"


def negotiate(graph: Graph, places: dict[str, Place]) -> None:
    """Checks links from the sinks upstream, so that converters are inserted as far downstream as possible.

    Args:
        graph: converters are added to it.
        places: place in the text of the link of a src pad, by the pad's path.

    Raises:
        DescriptionError: code `link`, if two pads have no common caps.
    """
    if graph.has_loop():
        raise DescriptionError("link", "the links form a loop; frames would never leave it")
    with remembered_caps(graph):
        for src, sink in _links_from_sinks(graph):
            offered, accepted = src.query_caps(), sink.query_caps()
            if offered.is_empty:
                # Due to a conflict further upstream, after which at most the pad's own caps are offered.
                offered = src.template.caps
            src.known_caps, sink.known_caps = offered, accepted
            if accepted.is_empty or accepted.can_intersect(offered):
                continue
            if not _convert(graph, src, sink, offered, accepted, places.get(src.path)):
                raise _conflict(src, sink, places)
            remember_caps(graph)
    with remembered_caps(graph):
        for src, sink in graph.links():
            if not sink.query_caps().can_intersect(src.query_caps()):
                raise _conflict(src, sink, places)


def remember_caps(graph: Graph) -> None:
    """Caches the caps query of every pad: sink pads from the sinks upstream, then src pads downstream."""
    forget_caps(graph)
    links = _links_from_sinks(graph)
    for _, sink in links:
        sink.known_caps = sink.query_caps()
    for src, _ in reversed(links):
        if src.known_caps is not None:
            continue
        if isinstance(src.element, Split):
            src.element.cache_branch_caps()
        else:
            src.known_caps = src.query_caps()


def forget_caps(graph: Graph) -> None:
    """Clears cached caps queries."""
    for element in graph.elements:
        for pad in list(element.pads.values()):
            pad.known_caps = None


@contextlib.contextmanager
def remembered_caps(graph: Graph) -> Iterator[None]:
    """Context in which caps queries are cached; otherwise each one traverses the graph."""
    try:
        remember_caps(graph)
        yield
    finally:
        forget_caps(graph)


def _links_from_sinks(graph: Graph) -> list[tuple[Pad, Pad]]:
    position = {element: index for index, element in enumerate(graph.from_sinks())}
    return sorted(graph.links(), key=lambda link: position[link[0].element])


def _conflict(src: Pad, sink: Pad, places: dict[str, Place]) -> DescriptionError:
    return caps_conflict(
        src.path, src.query_caps(), sink.path, sink.query_caps(), places.get(src.path), sink.element
    )


def _convert(graph: Graph, src: Pad, sink: Pad, offered: Caps, accepted: Caps, place: Place | None) -> bool:
    """Inserts a converter between raw-video pads that differ in format only; whether it did."""
    if CONVERTER not in available_elements() or not are_convertible(offered, accepted):
        return False
    with located(place):
        taken = {element.name for element in graph.elements}
        converter = make_element(CONVERTER, free_name(CONVERTER, taken))
    entry, leave = converter.pads["sink"], converter.pads["src"]
    src.unlink()
    src.link(entry)
    leave.link(sink)
    if not (entry.query_caps().can_intersect(offered) and accepted.can_intersect(leave.query_caps())):
        src.unlink()
        leave.unlink()
        src.link(sink)
        return False
    converter.bin = src.element.bin
    graph.elements.insert(graph.elements.index(src.element) + 1, converter)
    graph.inserted.append(converter)
    text = f"{converter.name} was inserted between {src.path} and {sink.path}: {offered} is not {accepted}"
    graph.warnings.append(("converter-inserted", text))
    return True
