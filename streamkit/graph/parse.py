"""The syntax tree of a description, and its parser."""

from __future__ import annotations

import functools
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.util import cache_from_source
from pathlib import Path
from typing import Any

from lark import Lark, Token, Transformer
from lark.exceptions import UnexpectedToken
from lark.parsers.lalr_interactive_parser import InteractiveParser
from lark.visitors import v_args

from streamkit.errors import DescriptionError, Place
from streamkit.graph.description_text import TOKEN_LIMIT, DescriptionLexer, ExpandedText, expand
from streamkit.masking import mask_secrets

DEPTH_LIMIT = 64
DEPTH_STEPS = {"OPEN": 1, "BINREF": 1, "CLOSE": -1}
NAMES = {
    "IDENTIFIER": "an element", "ASSIGNMENT": "a property", "CLOSE": "')'", "LINK": "'!'", "COMMA": "','",
    "$END": "the end",
}  # fmt: skip


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


@functools.cache
def _parser() -> Lark:
    grammar = Path(__file__).with_name("grammar.lark")
    # Making the tables takes a tenth of the start of a short pipeline; they are stored with the bytecode.
    tables = Path(cache_from_source(str(grammar))).with_suffix(".lalr")
    return Lark(
        grammar.read_text(encoding="utf-8"),
        parser="lalr",
        lexer=DescriptionLexer,
        maybe_placeholders=False,
        cache=False if sys.dont_write_bytecode else str(tables),
    )


def parse(text: str, variables: Mapping[str, str]) -> tuple[ChainNode, ...]:
    """The chains of a description; a `FaultNode` marks a syntax error; raises `DescriptionError`."""
    expanded = expand(text, variables)
    machine = _parser().parse_interactive("")
    fault: DescriptionError | None = None
    token, depth, count = Token("$END", "", start_pos=len(expanded.text)), 0, 0
    try:
        for token in DescriptionLexer(None).lex(expanded.text):
            count, depth = count + 1, depth + DEPTH_STEPS.get(token.type, 0)
            _check_bounds(expanded, token, count, depth)
            machine.feed_token(token)
        token = Token("$END", "", start_pos=len(expanded.text))
        if not count:
            raise DescriptionError("empty", "the description is empty: write at least one element")
        tree = machine.feed_token(token)
    except UnexpectedToken:
        fault = _fault(expanded, machine, token)
        tree = _close(machine)
    return tuple(_TreeBuilder(expanded, fault).transform(tree))


def _check_bounds(expanded: ExpandedText, token: Token, count: int, depth: int) -> None:
    if count <= TOKEN_LIMIT and depth <= DEPTH_LIMIT:
        return
    what = f"bins nest at most {DEPTH_LIMIT} deep"
    if count > TOKEN_LIMIT:
        what = f"a description has at most {TOKEN_LIMIT} words"
    raise DescriptionError("syntax", what, expanded.place(token.start_pos or 0, token.end_pos or 0))


def _accepted(machine: InteractiveParser) -> set[str]:
    return set(machine.accepts())  # type: ignore[no-untyped-call]


def _close(machine: InteractiveParser) -> Any:
    """Completes the input at a syntax error: adds an element without a name and closes open bins."""
    nameless = Token("IDENTIFIER", "")
    if _accepted(machine) == {"IDENTIFIER"}:  # inside a list of pads
        machine.feed_token(nameless)
    machine.feed_token(nameless)
    while "$END" not in _accepted(machine):
        machine.feed_token(Token("CLOSE", ")"))
    return machine.feed_token(Token("$END", ""))


def _fault(expanded: ExpandedText, machine: InteractiveParser, token: Token) -> DescriptionError:
    expected = ", ".join(sorted(NAMES[name] for name in _accepted(machine) if name in NAMES))
    if token.type == "$END":
        end = len(expanded.text.rstrip())
        last = expanded.text[:end].rsplit(maxsplit=1)[-1]
        is_attached = last.endswith(")") and "=" in last and "CLOSE" in _accepted(machine)
        return DescriptionError(
            "syntax",
            f"the description ends where {expected} must follow",
            expanded.place(max(0, end - 1), end),
            f"the ')' is part of the value of {last.partition('=')[0]}: put a blank before it"
            if is_attached
            else "",
        )
    place = expanded.place(token.start_pos or 0, token.end_pos or 0)
    shown = mask_secrets(str(token))
    shown = shown if len(shown) <= 40 else shown[:37] + "..."
    hint = ""
    if token.type == "ASSIGNMENT":
        shown = shown.partition("=")[0].strip() + "="  # a value may be a secret
        hint = "a property must follow its element"
    elif token.type == "ILLEGAL" and not token.isascii():
        hint = "names are ASCII; put other characters into quoted values"
    elif token.startswith("#"):
        hint = "comments stand in texts of several lines, as in a file (-f FILE)"
    elif token in ("'", '"'):
        hint = "write a caps filter without quotes, which only a shell needs"
    elif token == "\\":
        hint = "lines are joined without it; only a shell needs it"
    elif token.type == "CLOSE":
        hint = "no '(' is open here; a ')' that touches a property's value belongs to the value"
    return DescriptionError("syntax", f"unexpected {shown!r}; expected {expected}", place, hint)


@v_args(inline=True)
class _TreeBuilder(Transformer[Token, Any]):
    """Transforms lark's tree to the syntax tree."""

    def __init__(self, expanded: ExpandedText, fault: DescriptionError | None) -> None:
        super().__init__()
        self.expanded = expanded
        self.fault = fault

    def _place(self, token: Token) -> Any:
        return self.expanded.place(token.start_pos or 0, token.end_pos or 0)

    def start(self, *chains: ChainNode) -> list[ChainNode]:
        return list(chains)

    def chain(self, *parts: Node | LinkNode) -> ChainNode:
        nodes = tuple(part for part in parts if not isinstance(part, LinkNode))
        return ChainNode(nodes, tuple(part for part in parts if isinstance(part, LinkNode)))

    def padded(self, pads: tuple[str, ...], node: Node) -> Node:
        return with_pads(node, sink=pads)

    def element(self, node: Node, pads: tuple[str, ...] = ()) -> Node:
        return with_pads(node, src=pads)

    def simple(self, name: Token, *settings: Token) -> ElementNode | FaultNode:
        if not name and self.fault is not None:
            return FaultNode(self.fault)
        assignments = tuple(self._assignment(token) for token in settings if token.type == "ASSIGNMENT")
        presets = tuple(self._assignment(token) for token in settings if token.type == "PRESET")
        return ElementNode(str(name), self._place(name), assignments, presets)

    def bin(self, opening: Token, *parts: Any) -> BinNode:
        factory = "bin" if opening.type == "OPEN" else re.split(r"[\s.]", str(opening), maxsplit=1)[0]
        assignments = tuple(self._assignment(part) for part in parts[:-1] if isinstance(part, Token))
        chains = tuple(part for part in parts if isinstance(part, ChainNode))
        return BinNode(factory, self._place(opening), assignments, chains)

    def link(self, token: Token) -> LinkNode:
        inner = str(token)[1:-1]
        begin = (token.start_pos or 0) + 1 + len(inner) - len(inner.lstrip())

        def place_in_caps(offset: int, length: int) -> Any:
            return self.expanded.place(begin + offset, begin + offset + length)

        return LinkNode(self._place(token), inner.strip(), ":" in (token[0], token[-1]), place_in_caps)

    def pads(self, first: Token, *rest: Token) -> tuple[str, ...]:
        return (str(first)[1:], *(str(token) for token in rest if token.type != "COMMA"))

    def reference(self, token: Token, *rest: Token) -> ReferenceNode:
        name, _, pad = str(token).partition(".")
        more = tuple(str(item) for item in rest if item.type != "COMMA")
        return ReferenceNode(name, self._place(token), (pad, *more) if pad else more)

    def url(self, token: Token) -> UrlNode:
        return UrlNode(resolve_escapes(str(token)), self._place(token))

    def _assignment(self, token: Token) -> Assignment:
        name, _, value = str(token).partition("=")
        # Leading blanks belong to the name of a preset, as in gst-launch.
        value = value if token.type == "PRESET" else value.lstrip(" \t\n\r\f\v")
        return Assignment(name.strip(), value, self._place(token))


def unquote_value(text: str) -> str:
    """Launch-level unquoting: removes a pair of double quotes, resolves backslashes outside inner quotes.

    Source: GStreamer's description of gst-launch quoting.
    """
    if text and text[0] == text[-1] == '"':
        text = text[1:-1]
    return resolve_escapes(text)


def resolve_escapes(text: str) -> str:
    """Resolves backslashes, except between double quotes."""
    if "\\" not in text:
        return text
    kept: list[str] = []
    quoted, position = False, 0
    while position < len(text):
        mark = text[position]
        if mark == "\\" and not quoted:
            position += 1
            kept.append(text[position : position + 1])
        else:
            if mark == '"' and not (quoted and text[position - 1] == "\\"):
                quoted = not quoted
            kept.append(mark)
        position += 1
    return "".join(kept)
