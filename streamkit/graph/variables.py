"""Comments and `${VARIABLES}` of descriptions, resolved with a map back to the text as written."""

from __future__ import annotations

import bisect
import re
from collections.abc import Mapping
from dataclasses import dataclass

from streamkit.element.suggest import did_you_mean
from streamkit.errors import DescriptionError, Place

PIECE = re.compile(r"(?P<comment>(?<!\S)#[^\n]*)|\$\{(?P<name>[^}:\s]*)(?::-(?P<default>[^}\n]*))?\}")
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")
LENGTH_LIMIT = 1_000_000


@dataclass(frozen=True, slots=True)
class ExpandedText:
    """A description with comments blanked and variables replaced.

    Attributes:
        text: what is parsed.
        original: what was written.
        offsets: pairs (offset in `text`, offset in `original`) where a piece begins.
        line_starts: offsets in `original` where a line begins.
    """

    text: str
    original: str
    offsets: tuple[tuple[int, int], ...]
    line_starts: tuple[int, ...]

    def place(self, start: int, end: int) -> Place:
        """Line, column and length in the original of a stretch of the expanded text."""
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

    A comment begins with `#` at the start of a word, outside quotes, and ends with its line. A variable
    inside a property's value may hold blanks: they are escaped.

    Raises:
        DescriptionError: a variable has no value and no default, or the text is too long.
    """
    pieces: list[str] = []
    offsets: list[tuple[int, int]] = [(0, 0)]
    length, position = 0, 0
    for match in PIECE.finditer(text):
        if match["comment"] is not None and _in_quotes(text, match.start()):
            continue
        before = text[position : match.start()]
        if match["comment"] is not None:
            inserted = " " * len(match.group())
        else:
            inserted = _value(text, match, variables)
            if _in_value(text, match.start()):
                inserted = re.sub(r"([\s\\])", r"\\\1", inserted)
        pieces += [before, inserted]
        length += len(before)
        offsets.append((length, match.start()))
        length += len(inserted)
        offsets.append((length, match.end()))
        position = match.end()
        if length > LENGTH_LIMIT:
            break
    expanded = "".join([*pieces, text[position:]])
    if len(expanded) > LENGTH_LIMIT:
        raise DescriptionError("syntax", f"a description has at most {LENGTH_LIMIT} characters")
    return ExpandedText(expanded, text, tuple(offsets), _line_starts(text))


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
    hint = did_you_mean(name, variables) or f"give it with --set {name}=VALUE"
    raise DescriptionError(
        "syntax", f"variable {name!r} has no value and no default", _place_in(text, match), hint
    )


def _place_in(text: str, match: re.Match[str]) -> Place:
    return ExpandedText(text, text, ((0, 0),), _line_starts(text)).place(match.start(), match.end())


def _in_value(text: str, offset: int) -> bool:
    """Whether an offset lies in an unquoted property value."""
    before = text[max(0, offset - 4096) : offset]
    if not before or before[-1].isspace():
        return False
    _, mark, value = before.split()[-1].partition("=")
    return bool(mark) and not value.startswith('"')


def _in_quotes(text: str, offset: int) -> bool:
    line = text[text.rfind("\n", 0, offset) + 1 : offset]
    return len(re.findall(r'(?<!\\)"', line)) % 2 == 1
