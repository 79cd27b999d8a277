"""The syntax tree of a description."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from streamkit.errors import DescriptionError, Place


@dataclass(frozen=True, slots=True)
class Assignment:
    """`name=value`; `value` is as written, with quotes and escapes."""

    name: str
    value: str
    place: Place


@dataclass(frozen=True, slots=True)
class ElementNode:
    """An element: type, properties, and the pads named before and after it."""

    factory: str
    place: Place
    assignments: tuple[Assignment, ...] = ()
    presets: tuple[Assignment, ...] = ()
    sink_pads: tuple[str, ...] = ()
    src_pads: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class BinNode:
    """A group in brackets."""

    factory: str
    place: Place
    assignments: tuple[Assignment, ...]
    chains: tuple[ChainNode, ...]
    sink_pads: tuple[str, ...] = ()
    src_pads: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ReferenceNode:
    """`name.` or `name.pad,pad`: an element named elsewhere."""

    name: str
    place: Place
    pads: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class UrlNode:
    """A URI that stands for a source or sink of its scheme."""

    url: str
    place: Place


@dataclass(frozen=True, slots=True)
class FaultNode:
    """The place of a syntax error; an earlier node may contain an earlier error."""

    error: DescriptionError


@dataclass(frozen=True, slots=True)
class LinkNode:
    """`!` or `:`, with caps between two of them; `every_pad` if one of them is `:`.

    `place_in_caps` maps offset and length in the caps to a place in the text.
    """

    place: Place
    caps: str = ""
    every_pad: bool = False
    place_in_caps: Callable[[int, int], Place] | None = None


Node = ElementNode | BinNode | ReferenceNode | UrlNode | FaultNode


@dataclass(frozen=True, slots=True)
class ChainNode:
    """Nodes and the links between neighbours."""

    nodes: tuple[Node, ...]
    links: tuple[LinkNode, ...] = field(default=())


def with_pads(node: Node, *, sink: tuple[str, ...] = (), src: tuple[str, ...] = ()) -> Node:
    """A copy of an element or bin node with pads named on its sink or src side."""
    if not (sink or src) or not isinstance(node, ElementNode | BinNode):
        return node
    return replace(node, sink_pads=sink or node.sink_pads, src_pads=src or node.src_pads)
