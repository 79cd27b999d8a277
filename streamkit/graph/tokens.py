"""Lexer of the description language: the longest match wins, as in gst-launch.

Lark's own lexers take the first terminal that matches, not the longest.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from lark.lexer import Lexer, Token

from streamkit.element.registry import IDENTIFIER

TOKEN_LIMIT = 20_000  # of a description
BLANK = r"[ \t\n\r\f\v]"
VISIBLE = r"[^ \t\n\r\f\v]"
MIME = r"[A-Za-z0-9-]++/[A-Za-z0-9-]++"  # possessive: avoids quadratic backtracking for a missing `!`
CAPS = rf"{MIME}(?:\\[;!]|[^;!])*"
BLANKS = re.compile(rf"{BLANK}+")
ASSIGNED = re.compile(rf"(?:{IDENTIFIER}|@preset){BLANK}*={BLANK}*")
ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+,.\-]{0,63}://")  # bounded: lists of pads start alike
PATH = re.compile(r'[."{}_identfr]?/')  # these letters are a slip of gst-launch
# A blank after a backslash belongs to the word, even if that backslash is escaped.
WORD = re.compile(rf"(?:{VISIBLE}|(?<=\\)[ \t\r\f\v])+")
QUOTED = {'"': re.compile(r'"(?:\\"|[^"])*"'), "'": re.compile(r"'(?:\\'|[^'])*'")}
PLAIN = {
    "PADREF": re.compile(rf"\.{IDENTIFIER}"),
    "REF": re.compile(rf"{IDENTIFIER}\.(?:{IDENTIFIER})?"),
    "BINREF": re.compile(rf"{IDENTIFIER}{BLANK}*\.{BLANK}*\("),
    "IDENTIFIER": re.compile(IDENTIFIER),
    "LINK": re.compile(rf"[!:](?:{BLANK}*{CAPS}(?:;{BLANK}*{CAPS})*[!:])?"),
}
MARKS = {"(": "OPEN", ")": "CLOSE", ",": "COMMA"}


class DescriptionLexer(Lexer):
    """Splits a description into tokens; other characters become ILLEGAL tokens."""

    def __init__(self, lexer_conf: Any) -> None:
        """Lark passes a configuration, which is not needed."""

    def lex(self, data: str) -> Iterator[Token]:  # type: ignore[override]
        """Yields tokens with their offsets, without blanks."""
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
    first = text[position]
    if first in MARKS:
        return MARKS[first], position + 1
    best, best_end = "ILLEGAL", position + 1
    assigned = ASSIGNED.match(text, position)
    end = _value_end(text, assigned.end()) if assigned else 0
    if end:
        best, best_end = ("PRESET" if first == "@" else "ASSIGNMENT"), end
    for kind, pattern in PLAIN.items():
        match = pattern.match(text, position)
        if match and (match.end() > best_end or best == "ILLEGAL"):
            best, best_end = kind, match.end()
    end = _address_end(text, position)
    if end > best_end or (end and best == "ILLEGAL"):
        return "URL", end
    return best, best_end


def _value_end(text: str, position: int) -> int:
    """End of the value that starts here, or 0."""
    forms = [WORD.match(text, position)]
    if position < len(text) and text[position] in QUOTED:
        forms.append(QUOTED[text[position]].match(text, position))
    return max((match.end() for match in forms if match), default=0)


def _address_end(text: str, position: int) -> int:
    """End of the URI or path that starts here, or 0."""
    address = ADDRESS.match(text, position)
    if address:
        return _value_end(text, address.end()) or address.end()
    path = PATH.match(text, position)
    return _value_end(text, path.end()) if path else 0
