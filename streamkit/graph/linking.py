"""Makes the links of a description in textual order, with caps filters and ghost pads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from streamkit.element.base import Element
from streamkit.element.pad import Pad, Presence
from streamkit.element.registry import located, make_element
from streamkit.errors import DescriptionError, Place, did_you_mean
from streamkit.flow.caps import Caps
from streamkit.flow.video import misspelt_fields
from streamkit.graph.bins import BinTree
from streamkit.graph.graph import Graph
from streamkit.graph.link import DelayedLink, LinkRequest, awaits_pads, choose_pads, pad_pairs


@dataclass(frozen=True, slots=True)
class LinkEnd:
    """One end of a link: an element or its name, and the named pads."""

    element: Element | None
    name: str
    pads: tuple[str, ...]
    place: Place

    def pad_place(self, pad: str) -> Place | None:
        """The place of a pad's name in a reference; None without one."""
        if not self.name or pad not in self.pads:
            return None
        before = (self.name, *self.pads[: self.pads.index(pad)])
        column = self.place.column + sum(len(word) + 1 for word in before)
        return replace(self.place, column=column, length=len(pad))


@dataclass(frozen=True, slots=True)
class PendingLink:
    """A link to be made once all elements exist."""

    source: LinkEnd
    sink: LinkEnd
    caps: Caps | None
    every_pad: bool
    place: Place


class Linker:
    """Makes links one by one.

    Attributes:
        places: place in the text of the link of a src pad, by the pad's path.
        links: src and sink pads, in the order in which they were linked.
    """

    def __init__(self, graph: Graph, bins: BinTree, auto_name: Callable[[str], str]) -> None:
        self.places: dict[str, Place] = {}
        self.links: list[tuple[Pad, Pad]] = []
        self._graph = graph
        self._bins = bins
        self._auto_name = auto_name

    def make(self, link: PendingLink) -> None:
        """Makes a link, or a delayed link if the stream may add the pad; raises `DescriptionError`."""
        source, sink = self._resolve(link.source), self._resolve(link.sink)
        both_named = bool(link.source.pads and link.sink.pads)
        for request in pad_pairs(source, link.source.pads, sink, link.sink.pads, link.place):
            placed = request._replace(
                src_place=link.source.pad_place(request.src_name),
                sink_place=link.sink.pad_place(request.sink_name),
            )
            if link.every_pad and not both_named:
                self._make_all(placed, link.caps)
            else:
                self._make_or_delay(placed, link.caps, link.every_pad)

    def _make_or_delay(self, request: LinkRequest, caps: Caps | None, every_pad: bool) -> None:
        try:
            self._connect(request, caps, strict=False)
        except DescriptionError:
            if not awaits_pads(request.source):
                raise
            self._delay(request, caps, every_pad)

    def _make_all(self, request: LinkRequest, caps: Caps | None) -> None:
        """Links all pads that fit; once if both sides have request pads."""
        try:
            made = self._connect(request, caps, strict=True)
            while not (_on_request(made[0][0]) and _on_request(made[-1][1])):
                made = self._connect(request, caps, strict=True)
        except DescriptionError:
            pass
        if awaits_pads(request.source):
            self._delay(request, caps, every_pad=True)

    def _delay(self, request: LinkRequest, caps: Caps | None, every_pad: bool) -> None:
        def connect(now: LinkRequest) -> list[tuple[Pad, Pad]]:
            return self._connect(now, caps, strict=True)

        self._graph.delayed_links.append(DelayedLink(request, connect, every_pad))

    def _connect(self, request: LinkRequest, caps: Caps | None, *, strict: bool) -> list[tuple[Pad, Pad]]:
        if caps is None:
            return [self._link(*choose_pads(request, strict=strict), request.place)]
        capsfilter = self._make_filter(caps, request.place)
        self._bins.add(capsfilter, self._bins.container_of(request.source), request.place)
        self._bins.check_unique(capsfilter)
        made: list[tuple[Pad, Pad]] = []
        try:
            for now in (
                request._replace(sink=capsfilter, sink_name=""),
                request._replace(source=capsfilter, src_name=""),
            ):
                made.append(self._link(*choose_pads(now, strict=strict), request.place))
        except DescriptionError:
            self._undo(made)
            self._bins.remove(capsfilter)
            raise
        self._graph.elements.append(capsfilter)
        return made

    def _make_filter(self, caps: Caps, place: Place) -> Element:
        with located(place):
            capsfilter = make_element("capsfilter", self._auto_name("capsfilter"))
        capsfilter.set_property("caps", caps)
        capsfilter.set_in_text["caps"] = str(caps)
        self._graph.warnings += [("unknown-field", text) for text in misspelt_fields(caps)]
        return capsfilter

    def _link(self, src: Pad, sink: Pad, place: Place) -> tuple[Pad, Pad]:
        src.link(sink)
        self.places[src.path] = place
        self.links.append((src, sink))
        return src, sink

    def _undo(self, made: list[tuple[Pad, Pad]]) -> None:
        for src, sink in made:
            src.unlink()
            self.links.remove((src, sink))
            if src.template.presence is Presence.REQUEST:
                src.element.release_pad(src)

    def _resolve(self, endpoint: LinkEnd) -> Element:
        found = endpoint.element or self._bins.find(endpoint.name)
        if found is None:
            raise DescriptionError(
                "no-such-element", f"no element named {endpoint.name!r} in the pipeline", endpoint.place,
                did_you_mean(endpoint.name, [element.name for element in self._graph.elements]),
            )  # fmt: skip
        self._bins.check_unique(found)
        return found


def _on_request(pad: Pad) -> bool:
    return pad.template.presence is Presence.REQUEST
