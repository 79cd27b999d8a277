"""Description text to syntax tree."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from lark import Token, Transformer
from lark.exceptions import UnexpectedToken, VisitError
from lark.visitors import v_args

from streamkit.errors import DescriptionError
from streamkit.graph.grammar import parser
from streamkit.graph.syntax import (
    Assignment,
    BinNode,
    ChainNode,
    ElementNode,
    LinkNode,
    Node,
    ReferenceNode,
    UrlNode,
    with_pads,
)
from streamkit.graph.variables import ExpandedText, expand

NAMES = {
    "IDENTIFIER": "an element", "ASSIGNMENT": "a property", "CLOSE": "')'", "LINK": "'!'", "COMMA": "','",
    "$END": "the end",
}  # fmt: skip


def parse(text: str, variables: Mapping[str, str]) -> tuple[ChainNode, ...]:
    """The chains of a description.

    Raises:
        DescriptionError: the text is empty (code `empty`) or fits no rule (code `syntax`).
    """
    expanded = expand(text, variables)
    if not expanded.text.strip():
        raise DescriptionError("empty", "the description is empty: write at least one element")
    try:
        tree = parser().parse(expanded.text)
        return tuple(TreeBuilder(expanded).transform(tree))
    except UnexpectedToken as error:
        raise _syntax_error(expanded, error) from None
    except VisitError as error:
        raise error.orig_exc from None
    except RecursionError:
        raise DescriptionError("syntax", "bins are nested too deep; use fewer brackets") from None


def _syntax_error(expanded: ExpandedText, error: UnexpectedToken) -> DescriptionError:
    token = error.token
    expected = ", ".join(sorted(NAMES[name] for name in error.accepts or error.expected if name in NAMES))
    if token.type == "$END":
        end = len(expanded.text.rstrip())
        return DescriptionError(
            "syntax",
            f"the description ends where {expected} must follow",
            expanded.place(max(0, end - 1), end),
        )
    place = expanded.place(token.start_pos or 0, token.end_pos or 0)
    shown = str(token) if len(token) <= 40 else str(token)[:37] + "..."
    hint = ""
    if token.type == "ASSIGNMENT":
        hint = "a property stands right behind the element it belongs to"
    elif token.type == "ILLEGAL" and not token.isascii():
        hint = "names are ASCII; put other characters into quoted values"
    return DescriptionError("syntax", f"unexpected {shown!r}; here may stand {expected}", place, hint)


@v_args(inline=True)
class TreeBuilder(Transformer[Token, Any]):
    """Makes the syntax tree out of lark's."""

    def __init__(self, expanded: ExpandedText) -> None:
        super().__init__()
        self.expanded = expanded

    def _place(self, token: Token) -> Any:
        return self.expanded.place(token.start_pos or 0, token.end_pos or 0)

    def start(self, *chains: ChainNode) -> list[ChainNode]:
        """All chains; a reference alone or pads that no link uses are refused."""
        return list(chains)

    def chain(self, *parts: Node | LinkNode) -> ChainNode:
        """Nodes and the links between them."""
        nodes = tuple(part for part in parts if not isinstance(part, LinkNode))
        self._refuse_unused(nodes)
        return ChainNode(nodes, tuple(part for part in parts if isinstance(part, LinkNode)))

    def _refuse_unused(self, nodes: tuple[Node, ...]) -> None:
        if len(nodes) == 1 and isinstance(nodes[0], ReferenceNode):
            name = nodes[0].name
            raise DescriptionError(
                "syntax", f"unexpected reference {name!r}: link it to something with '!'", nodes[0].place
            )
        last = nodes[-1]
        if isinstance(last, ElementNode | BinNode) and last.src_pads:
            raise DescriptionError(
                "syntax",
                f"unexpected pad {last.src_pads[0]!r}: no link follows that could use it",
                last.place,
            )

    def padded(self, pads: tuple[str, ...], node: ElementNode | BinNode) -> Node:
        """An element with pads named on its sink side."""
        return with_pads(node, sink=pads)

    def element(self, node: ElementNode | BinNode, pads: tuple[str, ...] = ()) -> Node:
        """An element or bin with pads named on its src side."""
        return with_pads(node, src=pads)

    def simple(self, name: Token, *settings: Token) -> ElementNode:
        """An element type and what is set on it."""
        assignments = tuple(self._assignment(token) for token in settings if token.type == "ASSIGNMENT")
        presets = tuple(self._assignment(token) for token in settings if token.type == "PRESET")
        return ElementNode(str(name), self._place(name), assignments, presets)

    def bin(self, opening: Token, *parts: Any) -> BinNode:
        """A group; its own properties stand first."""
        factory = "bin" if opening.type == "OPEN" else re.split(r"[\s.]", str(opening), maxsplit=1)[0]
        assignments = tuple(self._assignment(part) for part in parts[:-1] if isinstance(part, Token))
        chains = tuple(part for part in parts if isinstance(part, ChainNode))
        return BinNode(factory, self._place(opening), assignments, chains)

    def link(self, token: Token) -> LinkNode:
        """A link with its filter."""
        return LinkNode(self._place(token), str(token)[1:-1].strip(), every_pad=token[0] == ":")

    def pads(self, first: Token, *rest: Token) -> tuple[str, ...]:
        """Pad names."""
        return (str(first)[1:], *(str(token) for token in rest if token.type != "COMMA"))

    def reference(self, token: Token, *rest: Token) -> ReferenceNode:
        """A name, and pads of it."""
        name, _, pad = str(token).partition(".")
        more = tuple(str(item) for item in rest if item.type != "COMMA")
        return ReferenceNode(name, self._place(token), (pad, *more) if pad else more)

    def url(self, token: Token) -> UrlNode:
        """An address."""
        return UrlNode(str(token), self._place(token))

    def _assignment(self, token: Token) -> Assignment:
        name, _, value = str(token).partition("=")
        return Assignment(name.strip(), value.lstrip(), self._place(token))


def unquote_value(text: str) -> str:
    """Launch level unquoting: one pair of double quotes off, backslashes resolved outside inner quotes.

    Source: GStreamer's description of gst-launch quoting; inner quotes protect what stands between them.
    """
    if len(text) >= 2 and text[0] == text[-1] == '"':
        text = text[1:-1]
    kept: list[str] = []
    quoted, position = False, 0
    while position < len(text):
        mark = text[position]
        if mark == "\\" and not quoted:
            position += 1
            kept.append(text[position : position + 1])
        else:
            quoted ^= mark == '"'
            kept.append(mark)
        position += 1
    return "".join(kept)
