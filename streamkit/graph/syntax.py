"""The syntax tree of a description."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from streamkit.errors import DescriptionError, Place


@dataclass(frozen=True, slots=True)
class Assignment:
    """`name=value`; `value` is the text as written, quotes and escapes still in it."""

    name: str
    value: str
    place: Place


@dataclass(frozen=True, slots=True)
class ElementNode:
    """An element: its type, its properties, and the pads named before and after it."""

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
    """An address that stands for a source or sink of its scheme."""

    url: str
    place: Place


@dataclass(frozen=True, slots=True)
class FaultNode:
    """Where the text stops fitting the grammar; what stands before it may hold an earlier error."""

    error: DescriptionError


@dataclass(frozen=True, slots=True)
class LinkNode:
    """`!` or `:`, with caps between two of them; `every_pad` where one of them is `:`.

    `place_in_caps` finds the place of a stretch of the caps, from its offset and length.
    """

    place: Place
    caps: str = ""
    every_pad: bool = False
    place_in_caps: Callable[[int, int], Place] | None = None


Node = ElementNode | BinNode | ReferenceNode | UrlNode | FaultNode


@dataclass(frozen=True, slots=True)
class ChainNode:
    """Nodes with a link between each two neighbours."""

    nodes: tuple[Node, ...]
    links: tuple[LinkNode, ...] = field(default=())


def with_pads(node: Node, *, sink: tuple[str, ...] = (), src: tuple[str, ...] = ()) -> Node:
    """The node with pads named on its sink or src side, where it has such sides."""
    if not (sink or src) or not isinstance(node, ElementNode | BinNode):
        return node
    return replace(node, sink_pads=sink or node.sink_pads, src_pads=src or node.src_pads)
