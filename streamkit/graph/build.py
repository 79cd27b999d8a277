"""Builds a graph from a syntax tree: elements in textual order, then links, then negotiation.

The order is that of gst-launch, so that the first of several errors is the one that it reports.
"""

from __future__ import annotations

import glob
import os
import re
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from streamkit.element.base import Element
from streamkit.element.pad_owner import walk
from streamkit.element.registry import available_elements, element_class, located, make_element
from streamkit.errors import CapsSyntax, CapsTooLarge, DescriptionError, ElementFailure, Place, did_you_mean
from streamkit.flow.caps import Caps
from streamkit.graph.assignments import (
    PendingProperty,
    factory_for,
    load_presets,
    location_of,
    name_in_text,
    set_on_bin,
    set_properties,
    try_child,
)
from streamkit.graph.bins import BIN_CLASSES, Bin, BinTree
from streamkit.graph.description_text import conceal
from streamkit.graph.files import FileConflict, check_files
from streamkit.graph.graph import Graph, auto_name
from streamkit.graph.linking import LinkEnd, Linker, file_hint
from streamkit.graph.negotiate import negotiate
from streamkit.graph.parse import (
    BinNode,
    ChainNode,
    ElementNode,
    FaultNode,
    LinkNode,
    Node,
    ReferenceNode,
    UrlNode,
    parse,
)
from streamkit.graph.processes.placement import cut
from streamkit.masking import mask_secrets, presentable


def build(text: str, variables: Mapping[str, str], taken: Container[str] = ()) -> Graph:
    """The graph of a description, its links checked; raises `DescriptionError`.

    Args:
        text: the description.
        variables: values of `${NAME}`.
        taken: names that are not given automatically.
    """
    try:
        graph = GraphBuilder(taken).build(parse(text, variables))
    except DescriptionError as error:
        found = _hinted(error, text)
        conceal(found, text)
        raise found from error.__cause__
    graph.text, graph.variables = text, variables
    graph.warnings[:] = [(code, presentable(what)) for code, what in graph.warnings]
    return graph


def _hinted(error: DescriptionError, text: str) -> DescriptionError:
    """The error, with a hint where what is no element is caps, or the last word and lacks its value."""
    if error.code != "no-such-element":
        return error
    written = text.split("\n")[error.place.line - 1][error.place.column - 1 :].rstrip()
    rest = written[error.place.length :]
    if rest == "=":  # as of an unset variable
        hint = f'{written} has no value; write one, or ""'
    elif rest.startswith("/"):
        hint = "a caps filter stands alone, between two elements"
        if os.path.isfile(name := written.split()[0]):
            hint = f"filesrc location={name} reads the file"
    else:
        return error
    return DescriptionError(error.code, error.message, error.place, hint)


@dataclass(frozen=True, slots=True)
class Endpoints:
    """The ends of links on the sink and src side of a node; None if no link is possible."""

    entry: LinkEnd | None
    leave: LinkEnd | None


class GraphBuilder:
    """Makes elements while traversing the tree, then links when all names are known."""

    def __init__(self, taken: Container[str]) -> None:
        self.graph = Graph()
        self._taken = taken
        self._bins = BinTree()
        self._linker = Linker(self.graph, self._bins, self._auto_name)
        self._places: dict[Element, Place] = {}
        self._numbers: Counter[str] = Counter()
        self._pending_links: list[tuple[LinkEnd, LinkEnd, LinkNode, Caps | None]] = []
        self._pending_properties: list[PendingProperty] = []

    def build(self, chains: Sequence[ChainNode]) -> Graph:
        """The graph of all chains; raises `DescriptionError`."""
        try:
            return self._build(chains)
        except ElementFailure as failure:
            raise self._failed(failure) from failure

    def _build(self, chains: Sequence[ChainNode]) -> Graph:
        members: list[Element] = []
        for chain in chains:
            self._add_chain(chain, members)
        self._add_to_bin(members, None)
        self._make_links()
        self._bins.add_ghost_pads(self._linker.links)
        self._bins.check_all_unique()
        self._set_pending_properties()
        self._check_files()
        if self.graph.has_loop():
            what = "the links form a loop: caps are not negotiated, and the pipeline will refuse to start"
            self.graph.warnings.append(("loop", what))
            for element in self.graph.elements:
                for pad in element.pads.values():
                    pad.known_caps = pad.template.caps  # a query would never return
        else:
            self._negotiate()
            self._check_order()
            cut(self.graph, self._places)
        return self.graph

    def _failed(self, failure: ElementFailure) -> DescriptionError:
        """The error for an element that raises when it is asked for caps."""
        places = {element.name: place for element, place in self._places.items()}
        hint = f"raised at {failure.place}" if failure.place else ""
        return DescriptionError("plugin-broken", str(failure), places.get(failure.element), hint)

    def _check_order(self) -> None:
        """Adds a warning for each element downstream of one that uses its metadata."""
        for element in self.graph.elements:
            wanted = element.wants_upstream()
            behind = walk(element.downstream(), Element.downstream) if wanted else ()
            for other in behind:
                if other.factory in wanted:
                    what = f"{element.name} does not get what {other.name} measures"
                    self.graph.warnings.append(("order", f"{what}: put {other.name} before it"))

    def _negotiate(self) -> None:
        try:
            negotiate(self.graph, self._linker.places)
        except CapsTooLarge as error:
            raise DescriptionError("link", f"the caps of the links cannot be compared: {error}") from None

    def _check_files(self) -> None:
        try:
            check_files(self.graph)
        except FileConflict as error:
            place = self._places.get(error.element, Place())
            raise DescriptionError("could-not-set-property", str(error), place) from None

    def _make_links(self) -> None:
        for link in self._pending_links:
            try:
                self._linker.make(*link)
            except DescriptionError:
                # Report caps conflicts of earlier links before this error.
                if not self.graph.has_loop():
                    self._negotiate()
                raise

    def _set_pending_properties(self) -> None:
        for group, item in self._pending_properties:
            if not try_child(group, item, self.graph.warnings):
                text = f"{group.name}: nothing to set {item.name} on"
                self.graph.warnings.append(("no-such-child", text))

    # Chains.

    def _add_chain(self, chain: ChainNode, members: list[Element]) -> Endpoints:
        """Makes the elements of a chain, records its links, and appends what is to be placed to `members`."""
        endpoints = self._add_node(chain.nodes[0], members, is_first=True)
        entry = endpoints.entry
        for link, node in zip(chain.links, chain.nodes[1:], strict=True):
            caps = _filter_caps(link)
            right = self._add_node(node, members, is_first=False)
            self._record_link(endpoints.leave, right.entry, link, caps)
            endpoints = right
        self._refuse_unused(chain)
        return Endpoints(entry, endpoints.leave)

    def _refuse_unused(self, chain: ChainNode) -> None:
        last = chain.nodes[-1]
        if isinstance(last, ReferenceNode) and len(chain.nodes) == 1:
            what = f"unexpected reference {last.name!r}: link it to something with '!'"
            raise DescriptionError("syntax", what, last.place, file_hint(last.name, last.pads))
        if isinstance(last, ElementNode | BinNode) and last.src_pads:
            what = f"unexpected pad {last.src_pads[0]!r}: no link follows that could use it"
            raise DescriptionError("syntax", what, last.place)

    def _record_link(
        self, left: LinkEnd | None, right: LinkEnd | None, link: LinkNode, caps: Caps | None
    ) -> None:
        if left is None or right is None:
            kind, edge = ("source", "ends") if left is None else ("sink", "begins")
            rule = f"link has no {kind}: the chain in the brackets {edge} with a reference or an address"
            raise DescriptionError("link", rule, link.place)
        self._pending_links.append((left, right, link, caps))

    # Nodes.

    def _add_node(self, node: Node, members: list[Element], *, is_first: bool) -> Endpoints:
        if isinstance(node, FaultNode):
            raise node.error
        if isinstance(node, BinNode):
            return self._add_bin(node, members)
        if isinstance(node, ReferenceNode):
            if is_first and (hint := self._unquoted(".".join((node.name, *node.pads)))):
                raise DescriptionError("syntax", f"unexpected reference {node.name!r}", node.place, hint)
            endpoint = LinkEnd(None, node.name, node.pads, node.place)
            return Endpoints(None, endpoint) if is_first else Endpoints(endpoint, None)
        if isinstance(node, UrlNode):
            element = self._make_from_uri(node, as_source=is_first)
            endpoint = LinkEnd(element, "", (), node.place)
            endpoints = Endpoints(None, endpoint) if is_first else Endpoints(endpoint, None)
        else:
            element = self._make_element(node)
            endpoint = LinkEnd(element, "", node.sink_pads, node.place)
            endpoints = Endpoints(endpoint, replace(endpoint, pads=node.src_pads))
        self._places[element] = node.place
        members.append(element)
        return endpoints

    def _make_element(self, node: ElementNode) -> Element:
        if node.factory in BIN_CLASSES:
            return self._make_empty_bin(node)
        with located(node.place):
            try:
                element_class(node.factory)  # its error comes before one of the name
            except DescriptionError as error:
                hint = self._unquoted(node.factory)
                raise (DescriptionError(error.code, error.message, None, hint) if hint else error) from None
        warnings = self.graph.warnings
        entry = available_elements()[node.factory]
        if entry.rivals:
            warnings.append(("rival", f"{entry.rivalry}; that of {entry.package} is used"))
        name = name_in_text(node, warnings) or self._auto_name(node.factory)
        with located(node.place):
            element = make_element(node.factory, name)
        set_properties(element, node.assignments, warnings)
        load_presets(element, node.presets)
        self.graph.elements.append(element)
        return element

    def _unquoted(self, word: str) -> str:
        """A hint where the word is the rest of the name of a file, which has a blank and no quotes, or ""."""
        last = self.graph.elements[-1] if self.graph.elements else None
        for name, value in last.set_in_text.items() if last else ():
            path = Path(str(value))
            is_file = bool(last and last.find_property(name).file)
            if is_file and any(path.parent.glob(f"{glob.escape(f'{path.name} {word}')}*")):
                return f'a value with a blank stands in quotes, {name}="{value} {word}..."'
        return ""

    def _make_empty_bin(self, node: ElementNode) -> Bin:
        """A bin written like an element: legal, but useless."""
        name = name_in_text(node, self.graph.warnings) or self._auto_name(node.factory)
        group = BIN_CLASSES[node.factory](name, node.factory)
        named = tuple(item for item in node.assignments if item.name != "name")
        self._pending_properties += set_on_bin(group, named, self.graph.warnings)
        load_presets(group, node.presets)
        self.graph.bins.append(group)
        return group

    def _make_from_uri(self, node: UrlNode, *, as_source: bool) -> Element:
        factory = factory_for(node.url, as_source=as_source, place=node.place)
        location = location_of(node.url, node.place)
        with located(node.place):
            element = make_element(factory, self._auto_name(factory))
        try:
            element.set_property("location", location)
        except ValueError as error:
            raise DescriptionError("no-such-element", f"{node.url}: {error}", node.place) from None
        element.set_in_text["location"] = location
        self.graph.elements.append(element)
        return element

    def _add_bin(self, node: BinNode, members: list[Element]) -> Endpoints:
        inside: list[Element] = []
        endpoints = [self._add_chain(chain, inside) for chain in node.chains]
        if not endpoints:
            raise DescriptionError("empty-bin", "a bin holds at least one element", node.place)
        if node.factory not in BIN_CLASSES:
            named = f'for a bin of this name write "bin.( name={node.factory} ... )"'
            hint = did_you_mean(node.factory, BIN_CLASSES) or named
            raise DescriptionError("no-such-element", f'no bin "{node.factory}"', node.place, hint)
        group = BIN_CLASSES[node.factory](self._auto_name(node.factory), node.factory)
        self._add_to_bin(inside, group)
        self._pending_properties += set_on_bin(group, node.assignments, self.graph.warnings)
        self._places[group] = node.place
        self.graph.bins.append(group)
        members.append(group)
        entry, leave = endpoints[0].entry, endpoints[-1].leave
        return Endpoints(
            replace(entry, pads=node.sink_pads or entry.pads) if entry else None,
            replace(leave, pads=node.src_pads) if leave else None,
        )

    def _add_to_bin(self, members: Sequence[Element], container: Bin | None) -> None:
        for member in members:
            self._bins.add(member, container, self._places.get(member, Place()))

    def _auto_name(self, factory: str) -> str:
        while True:
            name = auto_name(factory, self._numbers[factory])
            self._numbers[factory] += 1
            if name not in self._taken:
                return name


def _filter_caps(link: LinkNode) -> Caps | None:
    if not link.caps:
        return None
    try:
        return Caps(re.sub(r"\\(.)", r"\1", link.caps, flags=re.DOTALL) if "\\" in link.caps else link.caps)
    except CapsTooLarge as error:
        raise DescriptionError("link", f"could not parse caps: {error}", link.place) from None
    except CapsSyntax as error:
        place, hint = link.place, error.hint
        if "\\" not in link.caps and link.place_in_caps is not None and error.position < len(link.caps):
            place = link.place_in_caps(error.position, error.length)
        if " : " in link.caps:
            hint = "a filter runs on to the last ':' or the first '!': close it with '!'"
        elif link.caps[error.position :].lstrip().startswith(")"):
            hint = "a filter stands between two elements; at the end of a bin, write capsfilter caps=..."
        shown = mask_secrets(link.caps)
        shown = shown if len(shown) <= 60 else shown[:57] + "..."
        raise DescriptionError("link", f"could not parse caps {shown!r}: {error.rule}", place, hint) from None
