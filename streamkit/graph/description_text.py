"""The text of a description: its variables and comments, words and secrets."""

from __future__ import annotations

import bisect
import itertools
import re
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from lark.lexer import Lexer, Token

from streamkit.element.registry import IDENTIFIER, available_elements, element_class
from streamkit.errors import DescriptionError, Place, PluginBroken
from streamkit.masking import MASK, credential_spans, is_secret_name

VARIABLE = r"\$\{(?P<name>[^}:\s{]*)(?::-(?P<default>(?:[^}\n$]|\$(?!\{))*))?\}"  # not nested
# Quoted or escaped text contains no comments; variables in quotes are expanded.
COMMENT = r"(?P<comment>(?<!\S)(?<!\\[ \t])\#[^\n]*)"
QUOTED = r"""(?P<quoted>"(?:\\"|[^"])*"|(?<==)'(?:\\'|[^'])*')"""
PIECE = re.compile(rf"{VARIABLE}|{COMMENT}|{QUOTED}|\\[^\n]")
INSIDE = re.compile(VARIABLE)
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")
LENGTH_LIMIT = 1_000_000
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
QUOTES = {'"': re.compile(r'"(?:\\"|[^"])*"'), "'": re.compile(r"'(?:\\'|[^'])*'")}
PLAIN = {
    "PADREF": re.compile(rf"\.{IDENTIFIER}"),
    "REF": re.compile(rf"{IDENTIFIER}\.(?:{IDENTIFIER})?"),
    "BINREF": re.compile(rf"{IDENTIFIER}{BLANK}*\.{BLANK}*\("),
    "IDENTIFIER": re.compile(IDENTIFIER),
    "LINK": re.compile(rf"[!:](?:{BLANK}*{CAPS}(?:;{BLANK}*{CAPS})*[!:])?"),
}
MARKS = {"(": "OPEN", ")": "CLOSE", ",": "COMMA"}
MIN_PIECE = 3  # shorter ones occur in too many words of an error


@dataclass(frozen=True, slots=True)
class ExpandedText:
    """A description with comments blanked and variables replaced.

    Attributes:
        text: to be parsed.
        original: as written.
        offsets: start of each piece: (offset in `text`, offset in `original`).
        line_starts: offsets of lines in `original`.
    """

    text: str
    original: str
    offsets: tuple[tuple[int, int], ...]
    line_starts: tuple[int, ...]

    def place(self, start: int, end: int) -> Place:
        """The place in the original of a range of the expanded text."""
        first, last = self._original(start), self._original(max(start, end - 1))
        line = bisect.bisect_right(self.line_starts, first)
        return Place(line, first - self.line_starts[line - 1] + 1, max(1, last - first + 1))

    def _original(self, offset: int) -> int:
        index = bisect.bisect_right(self.offsets, (offset, len(self.original) + 1)) - 1
        expanded, original = self.offsets[index]
        following = self.offsets[index + 1][1] if index + 1 < len(self.offsets) else len(self.original)
        return min(original + offset - expanded, max(original, following - 1))


def expand(text: str, variables: Mapping[str, str]) -> ExpandedText:
    """Blanks comments and replaces `${NAME}` and `${NAME:-default}`.

    A comment starts with `#` at the start of a word, outside quotes, and ends with its line; a text of one
    line has none, as in gst-launch. Blanks of a variable inside a property value are escaped.

    Raises:
        DescriptionError: a variable has no value and no default, or the text is too long.
    """
    if len(text) > LENGTH_LIMIT:
        raise DescriptionError("syntax", f"a description has at most {LENGTH_LIMIT} characters")
    pieces: list[str] = []
    offsets: list[tuple[int, int]] = [(0, 0)]
    length, position = 0, 0
    for match in _pieces(text):
        pieces += [text[position : match.start()], _inserted(text, match, variables)]
        begin = length + match.start() - position
        length, position = begin + len(pieces[-1]), match.end()
        offsets += [(begin, match.start()), (length, position)]
        if length > LENGTH_LIMIT:
            break
    pieces.append(text[position:])
    if length + len(pieces[-1]) > LENGTH_LIMIT:
        raise DescriptionError("syntax", f"a description has at most {LENGTH_LIMIT} characters")
    return ExpandedText("".join(pieces), text, tuple(offsets), _line_starts(text))


def _pieces(text: str) -> Iterator[re.Match[str]]:
    """The comments and variables of a text, in order."""
    if "#" not in text and "${" not in text:
        return
    has_comments = "\n" in text
    for match in PIECE.finditer(text):
        if match["quoted"] is not None:
            yield from INSIDE.finditer(text, match.start(), match.end())
        elif match["name"] is not None or (match["comment"] is not None and has_comments):
            yield match


def variable_names(text: str) -> list[str]:
    """The names of the variables in a description, each once."""
    return list(dict.fromkeys(match["name"] for match in _pieces(text) if match["name"] is not None))


def missing_variables(text: str, given: Container[str]) -> list[str]:
    """The names of the variables in a description that have neither a value given nor a default."""
    needed = [match["name"] for match in _pieces(text) if match["name"] and match["default"] is None]
    return list(dict.fromkeys(name for name in needed if name not in given))


def unused_variables(text: str, given: Iterable[str]) -> list[str]:
    """A line for each variable given by `--set` that a description does not use; it is probably mistyped."""
    used = variable_names(text)
    known = f"it has {', '.join(used)}" if used else "it has no variables"
    return [
        f"--set {name} is not used: the description has no ${{{name}}}; "
        + (f"write it for ${name}" if re.search(rf"\${re.escape(name)}\b", text) else known)
        for name in given
        if name not in used
    ]


def _inserted(text: str, match: re.Match[str], variables: Mapping[str, str]) -> str:
    """The replacement of a comment or a variable."""
    if match["name"] is None:
        return " " * len(match.group())
    value = _value(text, match, variables)
    return re.sub(r"([\s\\])", r"\\\1", value) if _in_value(text, match.start()) else value


def _line_starts(text: str) -> tuple[int, ...]:
    return (0, *(match.end() for match in re.finditer(r"\n", text)))


def _value(text: str, match: re.Match[str], variables: Mapping[str, str]) -> str:
    name = match["name"]
    if not NAME.fullmatch(name):
        raise DescriptionError(
            "syntax", f"{match.group()!r} names no variable: ${{NAME}} or ${{NAME:-default}}",
            _place_in(text, match),
        )  # fmt: skip
    if name in variables:
        return variables[name]
    if match["default"] is not None:
        return match["default"]
    given = f"; given are {', '.join(variables)}" if variables else ""
    hint = f"give it with --set {name}=VALUE{given}"
    raise DescriptionError(
        "syntax", f"variable {name!r} has no value and no default", _place_in(text, match), hint
    )


def _place_in(text: str, match: re.Match[str]) -> Place:
    return ExpandedText(text, text, ((0, 0),), _line_starts(text)).place(match.start(), match.end())


def _in_value(text: str, offset: int) -> bool:
    """Whether an offset is in an unquoted property value."""
    before = text[max(0, offset - 4096) : offset]
    if not before or before[-1].isspace():
        return False
    _, mark, value = before.split()[-1].partition("=")
    return bool(mark) and not value.startswith('"')


class DescriptionLexer(Lexer):
    """Splits a description into tokens; other characters become ILLEGAL tokens.

    The longest match wins, as in gst-launch; lark's own lexers take the first terminal that matches.
    """

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
    if position < len(text) and text[position] in QUOTES:
        forms.append(QUOTES[text[position]].match(text, position))
    return max((match.end() for match in forms if match), default=0)


def _address_end(text: str, position: int) -> int:
    """End of the URI or path that starts here, or 0."""
    address = ADDRESS.match(text, position)
    if address:
        return _value_end(text, address.end()) or address.end()
    path = PATH.match(text, position)
    return _value_end(text, path.end()) if path else 0


def conceal(error: DescriptionError, text: str) -> None:
    """Masks the secrets of a text in an error about it.

    A password with blanks is parsed as several words, which an error may name as elements.
    """
    pieces = {
        piece
        for start, end in credential_spans(text)
        if re.search(r"\s", text[start:end])
        for piece in re.split(r"[\s:@/!]+", text[start:end])
        if len(piece) >= MIN_PIECE
    }
    if pieces:
        words = re.compile("|".join(re.escape(piece) for piece in sorted(pieces, key=len, reverse=True)))
        error.message, error.hint = words.sub(MASK, error.message), words.sub(MASK, error.hint)
        error.args = (error.message + (f"; {error.hint}" if error.hint else ""),)
    error.secrets = secret_assignments(text)


def secret_assignments(text: str) -> tuple[str, ...]:
    """The assignments of a text whose values are secret, as written."""
    found: list[str] = []
    factory = ""
    for token in itertools.islice(DescriptionLexer(None).lex(text), TOKEN_LIMIT):
        if token.type == "IDENTIFIER":
            factory = str(token)
        elif token.type == "ASSIGNMENT":
            name = str(token).partition("=")[0].strip().rpartition("::")[2]
            if is_secret_name(name) or _is_declared_secret(factory, name):
                found.append(str(token))
    return tuple(found)


def _is_declared_secret(factory: str, name: str) -> bool:
    if factory not in available_elements():  # no search for a similar name: a text may have thousands
        return False
    try:
        declaration = element_class(factory).declaration_of(name)
    except PluginBroken:
        return False
    return declaration is not None and declaration.secret
