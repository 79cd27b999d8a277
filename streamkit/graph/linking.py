"""Makes the links of a description in textual order; some wait for a pad that the stream brings."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad, Presence
from streamkit.element.registry import located, make_element
from streamkit.errors import DescriptionError, ElementFailure, NotNegotiated, Place, did_you_mean
from streamkit.flow.caps import Caps
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.video import misspelt_fields
from streamkit.graph.bins import BinTree, bin_of
from streamkit.graph.graph import Graph
from streamkit.graph.link import (
    CODED_VIDEO,
    RAW,
    RAW_VIDEO,
    LinkRequest,
    awaits_pads,
    check_names,
    choose_pads,
)
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


@dataclass(slots=True)
class DelayedLink:
    """A link that is tried whenever its source adds a pad.

    Attributes:
        request: the link, whose source adds the pad.
        make: makes a link, with its caps filter.
        has_succeeded: whether it has linked a pad.
    """

    request: LinkRequest
    make: Callable[[LinkRequest], object]
    has_succeeded: bool = False

    @property
    def description(self) -> str:
        """The link as text."""
        request = self.request
        src = f"{request.source.name}.{request.src_name}"
        return f"{src} ! {request.sink.name}{'.' if request.sink_name else ''}{request.sink_name}"

    def try_link(self, pad: Pad) -> None:
        """Links a new pad if it matches."""
        request = self.request
        is_awaited = pad.element is request.source and pad.is_src and pad.peer is None
        is_named = request.src_name in ("", pad.name, pad.template.name)
        if is_awaited and is_named and (request.every_pad or not self.has_succeeded):
            with contextlib.suppress(DescriptionError):
                self.make(replace(request, src_name=pad.name))
                self.has_succeeded = True


def report_missing_pads(
    element: Element, links: Iterable[DelayedLink], post: Callable[[Message], None]
) -> None:
    """Warns of the links that wait for a pad of an element, which adds no more.

    Raises:
        ElementFailure: no pad of the element is linked, for example because a decoder is missing.
    """
    waiting = [
        link
        for link in links
        if link.request.source is element and not (link.has_succeeded or link.request.every_pad)
    ]
    if waiting and all(pad.peer is None for pad in element.src_pads()):
        raise ElementFailure(element.name, element.factory, _unlinked(element, waiting[0]))
    for link in waiting:
        text = f"the stream has no pad for {link.description}; {_pads_text(element)}"
        post(Message(MessageKind.WARNING, element.name, text, {"code": "delayed-link"}))


def _unlinked(element: Element, link: DelayedLink) -> NotNegotiated:
    """The error for an element of which the stream has no pad that fits the element downstream."""
    pads = list(element.src_pads())
    media = [pad.caps.name for pad in pads if pad.caps is not None and not pad.caps.is_any]
    # A live source has caps with its first packet only.
    possible = media or [item.name for pad in pads for item in pad.template.caps.structures]
    coded = next((name for name in possible if name.startswith(CODED_VIDEO)), RAW)
    takes_video = any(
        template.direction is Direction.SINK and template.caps.can_intersect(RAW_VIDEO)
        for template in link.request.sink.pad_templates.values()
    )
    if coded != RAW and takes_video and not link.request.src_name:
        sink = link.request.sink.name
        kind = f" ({coded})" if media else ""
        return NotNegotiated(
            f"gives coded packets{kind}, which {sink} does not take: put decode between, "
            f"{element.name} ! decode ! {sink}"
        )
    return NotNegotiated(
        f"none of its pads is linked: the stream has no pad for {link.description}; {_pads_text(element)}; "
        "insert an element that accepts them"
    )


def _pads_text(element: Element) -> str:
    """The src pads of an element with their media types, for a warning."""
    pads = [
        pad.name if pad.caps is None or pad.caps.is_any else f"{pad.name} with {pad.caps.name}"
        for pad in element.src_pads()
    ]
    return f"it has {', '.join(pads)}" if pads else "it has none at all"
