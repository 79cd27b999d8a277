"""Tokens of the description language: at each place the longest match wins, as in gst-launch.

A lexer of our own because lark's take the first terminal that fits, not the longest.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from lark.lexer import Lexer, Token

IDENTIFIER = r"[A-Za-z0-9_][A-Za-z0-9_\-%:]*"
MIME = r"[A-Za-z0-9-]++/[A-Za-z0-9-]++"  # possessive: else a missing `!` is looked for in all splits
CAPS = rf"{MIME}(?:\\[\s\S]|[^;!\\])*"
BLANKS = re.compile(r"\s+")
ASSIGNED = re.compile(rf"(?:{IDENTIFIER}|@preset)\s*=\s*", re.ASCII)
STRINGS = (
    re.compile(r"(?:\\[^\n]|[^\s\\])+"),
    re.compile(r'"(?:\\"|[^"])*"'),
    re.compile(r"'(?:\\'|[^'])*'"),
)
PLAIN = (
    ("PADREF", re.compile(rf"\.{IDENTIFIER}", re.ASCII)),
    ("REF", re.compile(rf"{IDENTIFIER}\.(?:{IDENTIFIER})?", re.ASCII)),
    ("BINREF", re.compile(rf"{IDENTIFIER}\s*\.\s*\(", re.ASCII)),
    ("IDENTIFIER", re.compile(IDENTIFIER, re.ASCII)),
    ("LINK", re.compile(rf"[!:](?:\s*{CAPS}(?:;\s*{CAPS})*[!:])?", re.ASCII)),
    ("URL", re.compile(r"(?:[A-Za-z][A-Za-z0-9+,.\-]*://|[A-Za-z._{}]/)(?:\\[^\n]|[^\s\\])*", re.ASCII)),
    ("OPEN", re.compile(r"\(")),
    ("CLOSE", re.compile(r"\)")),
    ("COMMA", re.compile(r",")),
    ("ILLEGAL", re.compile(r"[\s\S]")),
)


class DescriptionLexer(Lexer):
    """Cuts a description into tokens; a character that fits nothing becomes an ILLEGAL token."""

    def __init__(self, lexer_conf: Any) -> None:
        """Takes what lark hands to a lexer; nothing of it is needed."""

    def lex(self, data: str) -> Iterator[Token]:  # type: ignore[override]
        """Tokens with their offsets, blanks left out."""
        position = 0
        while position < len(data):
            blanks = BLANKS.match(data, position)
            if blanks:
                position = blanks.end()
                continue
            kind, end = _longest(data, position)
            yield Token(kind, data[position:end], start_pos=position, end_pos=end)
            position = end


def _longest(text: str, position: int) -> tuple[str, int]:
    best, best_end = "ILLEGAL", position
    assigned = ASSIGNED.match(text, position)
    if assigned:
        ends = [match.end() for match in (form.match(text, assigned.end()) for form in STRINGS) if match]
        if ends:
            best, best_end = ("PRESET" if text[position] == "@" else "ASSIGNMENT"), max(ends)
    for kind, pattern in PLAIN:
        match = pattern.match(text, position)
        if match and match.end() > best_end:
            best, best_end = kind, match.end()
    return best, best_end
