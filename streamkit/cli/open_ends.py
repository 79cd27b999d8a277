"""Notes of `launch` on elements that wait for calls of an application, and on pads without a link."""

from __future__ import annotations

from collections.abc import Iterator

from streamkit.element.base import Element
from streamkit.element.pad import Direction
from streamkit.graph.graph import Graph
from streamkit.graph.link import RAW_VIDEO


def open_ends(graph: Graph) -> Iterator[str]:
    """A note for each."""
    for element in graph.elements:
        if element.factory == "appsink":
            effect = "drops frames" if getattr(element, "drop", False) else "fills up"
            yield f"{element.name} {effect}, as only a Python program takes its frames; write fakesink here"
        elif element.factory == "appsrc":
            yield f"{element.name} waits, as only a Python program gives it frames; write fakesrc here"
        outputs = list(element.src_pads())
        # Those on request follow the element's own, and are made when they are linked.
        if outputs and any(element.sink_pads()) and outputs[0].peer is None:
            yield f"{outputs[0].path} is not linked, its frames go nowhere; link it to a sink"
        if not graph.delayed_links:
            yield from _missing_input(element)


def _missing_input(element: Element) -> Iterator[str]:
    """A note if no frame can come: the pad `sink` is not linked, or no input was requested."""
    sink = element.pads.get("sink")
    if sink is not None and sink.peer is None:
        takes_video = not sink.template.caps.is_any and sink.template.caps.can_intersect(RAW_VIDEO)
        source = "filesrc location=FILE ! decode" if takes_video else "a source"
        yield f"{sink.path} is not linked, no frame comes; write {source} ! before {element.factory}"
    templates = element.pad_templates.values()
    if not any(element.sink_pads()) and any(item.direction is Direction.SINK for item in templates):
        yield f"{element.name} has no input, no frame comes; write a source ! {element.name}."
