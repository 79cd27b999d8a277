"""Makes the links of a description in textual order, with caps filters and ghost pads."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass, replace

from streamkit.element.base import Element
from streamkit.element.pad import Pad, Presence
from streamkit.element.registry import located, make_element
from streamkit.errors import DescriptionError, Place, did_you_mean
from streamkit.flow.caps import Caps
from streamkit.flow.video import misspelt_fields
from streamkit.graph.bins import BinTree, bin_of
from streamkit.graph.delayed_link import DelayedLink
from streamkit.graph.graph import Graph
from streamkit.graph.link import LinkRequest, awaits_pads, check_names, choose_pads
from streamkit.graph.parse import LinkNode


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

    def make(self, left: LinkEnd, right: LinkEnd, link: LinkNode, caps: Caps | None) -> None:
        """Makes a link, or a delayed link if the stream may add the pad; raises `DescriptionError`."""
        source, sink = self._resolve(left), self._resolve(right)
        src_names, sink_names = left.pads, right.pads
        both_named = bool(src_names and sink_names)
        if both_named and len(src_names) != len(sink_names):
            what = f"{len(src_names)} pads of {source.name} cannot meet {len(sink_names)} pads of {sink.name}"
            raise DescriptionError("link", what, link.place)
        if not both_named:
            src_names, sink_names = ("".join(src_names[:1]),), ("".join(sink_names[:1]),)
        for src_name, sink_name in zip(src_names, sink_names, strict=True):
            places = left.pad_place(src_name), right.pad_place(sink_name)
            request = LinkRequest(
                source, src_name, sink, sink_name, link.place, *places, caps, link.every_pad
            )
            if link.every_pad and not both_named:
                self._make_all(request)
            else:
                self._make_or_delay(request)

    def _make_or_delay(self, request: LinkRequest) -> None:
        try:
            self._connect(request)
        except DescriptionError:
            if not awaits_pads(request.source):
                raise
            check_names(request)
            self._graph.delayed_links.append(DelayedLink(request, self._connect_strictly))

    def _make_all(self, request: LinkRequest) -> None:
        """Links all pads that fit; once if both sides have request pads."""
        with contextlib.suppress(DescriptionError):
            made = self._connect_strictly(request)
            while not (_on_request(made[0][0]) and _on_request(made[-1][1])):
                made = self._connect_strictly(request)
        if awaits_pads(request.source):
            self._graph.delayed_links.append(DelayedLink(request, self._connect_strictly))

    def _connect_strictly(self, request: LinkRequest) -> list[tuple[Pad, Pad]]:
        return self._connect(request, strict=True)

    def _connect(self, request: LinkRequest, *, strict: bool = False) -> list[tuple[Pad, Pad]]:
        if request.caps is None:
            return [self._link(*choose_pads(request, strict=strict), request.place)]
        capsfilter = self._make_filter(request.caps, request.place)
        self._bins.add(capsfilter, bin_of(request.source), request.place)
        self._bins.check_unique(capsfilter)
        made: list[tuple[Pad, Pad]] = []
        try:
            for now in (
                replace(request, sink=capsfilter, sink_name=""),
                replace(request, source=capsfilter, src_name=""),
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
                file_hint(endpoint.name, endpoint.pads)
                or did_you_mean(endpoint.name, [element.name for element in self._graph.elements]),
            )  # fmt: skip
        self._bins.check_unique(found)
        return found


def _on_request(pad: Pad) -> bool:
    return pad.template.presence is Presence.REQUEST


def file_hint(name: str, pads: tuple[str, ...]) -> str:
    """What reads a file whose name, such as flight.mp4, stands for a pad of an element, or ""."""
    file = ".".join((name, *pads))
    return f"filesrc location={file} reads the file" if pads and os.path.isfile(file) else ""
