"""Syntax tree to graph: elements in textual order, then links, then negotiation."""

from __future__ import annotations

import re
import urllib.parse
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from streamkit.element.base import Element
from streamkit.element.property_text import unquote_string
from streamkit.element.registry import element_class, installed_elements, make_element
from streamkit.element.suggest import did_you_mean
from streamkit.errors import CapsSyntax, DescriptionError, Place, PluginBroken, StreamkitError
from streamkit.flow.caps import Caps
from streamkit.graph.graph import Bin, Graph
from streamkit.graph.link import link_elements
from streamkit.graph.negotiate import negotiate
from streamkit.graph.parse import parse, unquote_value
from streamkit.graph.syntax import (
    Assignment,
    BinNode,
    ChainNode,
    ElementNode,
    LinkNode,
    Node,
    ReferenceNode,
    UrlNode,
)

BIN_FACTORIES = ("bin", "pipeline")
DEPTH_LIMIT = 64


def build(text: str, variables: Mapping[str, str]) -> Graph:
    """The graph of a description, its links checked.

    Raises:
        DescriptionError: the first thing that is wrong, with its place in the text.
    """
    builder = GraphBuilder()
    for chain in parse(text, variables):
        builder.add_chain(chain, "", 0)
    builder.make_links()
    negotiate(builder.graph, builder.places)
    return builder.graph


@dataclass(frozen=True, slots=True)
class End:
    """One end of a link: an element, or the name of one, and the pads named on it."""

    element: Element | None
    name: str
    pads: tuple[str, ...]
    place: Place


@dataclass(frozen=True, slots=True)
class Ends:
    """What stands at the two sides of a node; None where a bin begins or ends in nothing."""

    entry: End | None
    leave: End | None


class GraphBuilder:
    """Makes elements while walking the tree and links when all names are known."""

    def __init__(self) -> None:
        self.graph = Graph()
        self.places: dict[str, Place] = {}
        self._numbers: Counter[str] = Counter()
        self._pending: list[tuple[End | None, End | None, LinkNode]] = []

    # Elements.

    def add_chain(self, chain: ChainNode, parent: str, depth: int) -> Ends:
        """Makes what a chain holds and notes its links."""
        ends = []
        for index, node in enumerate(chain.nodes):
            ends.append(self._add_node(node, parent, depth, is_first=index == 0))
        for link, left, right in zip(chain.links, ends, ends[1:], strict=False):
            self._pending.append((left.leave, right.entry, link))
        return Ends(ends[0].entry, ends[-1].leave)

    def _add_node(self, node: Node, parent: str, depth: int, *, is_first: bool) -> Ends:
        if isinstance(node, ReferenceNode):
            end = End(None, node.name, node.pads, node.place)
            return Ends(end, end)
        if isinstance(node, BinNode):
            return self._add_bin(node, parent, depth)
        if isinstance(node, UrlNode):
            element = self._make_from_url(node, as_source=is_first)
            self._place_in(element, parent, node.place)
            return Ends(End(element, "", (), node.place), End(element, "", (), node.place))
        element = self._make_element(node)
        self._place_in(element, parent, node.place)
        return Ends(End(element, "", node.sink_pads, node.place), End(element, "", node.src_pads, node.place))

    def _place_in(self, element: Element, parent: str, place: Place) -> None:
        if element.name in {other.name for other in self.graph.elements}:
            raise DescriptionError(
                "link", f"two elements are named {element.name!r}; names are unique in a pipeline", place
            )
        element.parent = parent
        self.graph.elements.append(element)

    def _auto_name(self, factory: str) -> str:
        number = self._numbers[factory]
        self._numbers[factory] += 1
        return f"{factory}{number}"

    def _make_element(self, node: ElementNode) -> Element:
        try:
            known = element_class(node.factory)
        except DescriptionError as error:
            raise DescriptionError(error.code, error.message, node.place, error.hint) from None
        except PluginBroken as error:
            raise DescriptionError("plugin-broken", str(error), node.place) from error
        if node.presets:
            raise DescriptionError(
                "could-not-set-property", f"{node.factory} has no presets", node.presets[0].place
            )
        settings = [item for item in node.assignments if item.name != "name"]
        names = [item for item in node.assignments if item.name == "name"]
        for item in settings:
            if item.name.replace("-", "_") not in known.properties:
                hint = did_you_mean(item.name, [name.replace("_", "-") for name in known.properties])
                raise DescriptionError(
                    "no-such-property", f"{node.factory} has no property {item.name!r}", item.place, hint
                )
        automatic = self._auto_name(node.factory) if not names else ""
        element = _make(node.factory, unquote_value(names[0].value) if names else automatic, node.place)
        for item in settings:
            _set(element, item)
        return element

    def _make_from_url(self, node: UrlNode, *, as_source: bool) -> Element:
        scheme, mark, rest = node.url.partition("://")
        factory = f"{scheme.lower()}{'src' if as_source else 'sink'}"
        if not mark or factory not in installed_elements():
            kind = "source" if as_source else "sink"
            what = f"scheme {scheme!r}" if mark else f"the path {node.url!r}"
            raise DescriptionError(
                "no-such-element", f"no {kind} element for {what}", node.place,
                "" if mark else "write file://PATH, or filesrc location=PATH",
            )  # fmt: skip
        location = urllib.parse.unquote(rest) if scheme.lower() == "file" else node.url
        element = _make(factory, self._auto_name(factory), node.place)
        _set_text(element, "location", location, node.place)
        return element

    # Bins.

    def _add_bin(self, node: BinNode, parent: str, depth: int) -> Ends:
        if depth >= DEPTH_LIMIT:
            raise DescriptionError("syntax", f"bins nest at most {DEPTH_LIMIT} deep", node.place)
        if node.factory not in BIN_FACTORIES:
            raise DescriptionError(
                "no-such-element",
                f'no bin "{node.factory}"',
                node.place,
                did_you_mean(node.factory, BIN_FACTORIES),
            )
        if not node.chains:
            raise DescriptionError("empty-bin", "a bin holds at least one element", node.place)
        first = len(self.graph.elements)
        inner_bins = len(self.graph.bins)
        ends = [self.add_chain(chain, "", depth + 1) for chain in node.chains]
        name = self._bin_name(node)
        for element in self.graph.elements[first:]:
            element.parent = element.parent or name
        for index, inner in enumerate(self.graph.bins[inner_bins:], inner_bins):
            if not inner.parent:
                self.graph.bins[index] = Bin(inner.name, inner.factory, name)
        self.graph.bins.append(Bin(name, node.factory, parent))
        entry, leave = ends[0].entry, ends[-1].leave
        return Ends(
            End(entry.element, entry.name, node.sink_pads or entry.pads, node.place) if entry else None,
            End(leave.element, leave.name, node.src_pads or leave.pads, node.place) if leave else None,
        )

    def _bin_name(self, node: BinNode) -> str:
        name = ""
        for item in node.assignments:
            if item.name == "name":
                name = unquote_value(item.value)
                continue
            child, mark, child_property = item.name.partition("::")
            target = next((e for e in self.graph.elements if e.name == child), None) if mark else None
            if target is None:
                raise DescriptionError(
                    "no-such-property", f"{node.factory} has no property {item.name!r}", item.place
                )
            _set(target, Assignment(child_property, item.value, item.place))
        return name or self._auto_name(node.factory)

    # Links.

    def make_links(self) -> None:
        """Links everything, in textual order."""
        for left, right, link in self._pending:
            self._make_link(self._resolve(left, link, "source"), self._resolve(right, link, "sink"), link)

    def _resolve(self, end: End | None, link: LinkNode, kind: str) -> End:
        if end is None:
            raise DescriptionError("link", f"link has no {kind}", link.place)
        if end.element is not None:
            return end
        for element in self.graph.elements:
            if element.name == end.name:
                return End(element, end.name, end.pads, end.place)
        known = [element.name for element in self.graph.elements]
        raise DescriptionError(
            "no-such-element", f"no element named {end.name!r} in the pipeline", end.place,
            did_you_mean(end.name, known),
        )  # fmt: skip

    def _make_link(self, left: End, right: End, link: LinkNode) -> None:
        source, sink = left.element, right.element
        assert source is not None
        assert sink is not None
        if not link.caps:
            for src, _ in link_elements(source, left.pads, sink, right.pads, link.place):
                self.places[src.path] = link.place
            return
        try:
            caps = Caps(
                re.sub(r"\\(.)", r"\1", link.caps, flags=re.DOTALL) if "\\" in link.caps else link.caps
            )
        except CapsSyntax as error:
            raise DescriptionError("link", f"could not parse caps: {error}", link.place) from None
        capsfilter = _make("capsfilter", self._auto_name("capsfilter"), link.place)
        capsfilter.set_property("caps", caps)
        capsfilter.set_in_text["caps"] = str(caps)
        self._place_in(capsfilter, source.parent, link.place)
        for src, _ in [
            *link_elements(source, left.pads, capsfilter, (), link.place),
            *link_elements(capsfilter, (), sink, right.pads, link.place),
        ]:
            self.places[src.path] = link.place


def _make(factory: str, name: str, place: Place) -> Element:
    try:
        return make_element(factory, name)
    except PluginBroken as error:
        raise DescriptionError("plugin-broken", str(error), place) from error


def _set(element: Element, item: Assignment) -> None:
    _set_text(element, item.name, unquote_value(item.value), item.place)


def _set_text(element: Element, name: str, value: str, place: Place) -> None:
    declaration = element.properties.get(name.replace("-", "_"))
    try:
        if declaration is not None and declaration.kind is str:
            value = unquote_string(value)
        element.set_property(name, value)
    except Exception as error:
        if declaration is None:
            raise DescriptionError("no-such-property", str(error), place) from None
        if not isinstance(error, StreamkitError):
            error = declaration.refusal(value, f"{type(error).__name__}: {error}", element.name)
        hint = did_you_mean(value, declaration.choices) if declaration.choices else ""
        raise DescriptionError("could-not-set-property", str(error), place, hint) from None
    element.set_in_text[name] = value
