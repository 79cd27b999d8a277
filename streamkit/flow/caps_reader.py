"""Parser of caps: structures with features and fields; values, ranges, lists, nested caps.

Source: the caps syntax of GStreamer's documentation ("Appendices: caps syntax").
"""

from __future__ import annotations

import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from streamkit.errors import CapsSyntax
from streamkit.flow.caps_structure import Structure
from streamkit.flow.caps_text import READERS, TYPES, read_string, read_untyped
from streamkit.flow.caps_values import (
    SCALARS,
    FloatRange,
    FractionRange,
    Int64,
    Int64Range,
    IntRange,
    NestedCaps,
    NestedStructure,
    Range,
    Value,
    ValueArray,
    ValueList,
)

NAME = re.compile(r"[A-Za-z][A-Za-z0-9/_.:+*-]*")
FIELD = re.compile(r"[A-Za-z0-9_/.:+-]+")
BARE = re.compile(r"[A-Za-z0-9_+/:.*-]+")
QUOTED = re.compile(r'"(?:[^"\\]|\\.)*"', re.DOTALL)
UNESCAPED = re.compile(r"\\(.)", re.DOTALL)
FEATURE = re.compile(r"ANY(?![A-Za-z:])|[A-Za-z]+:[A-Za-z][A-Za-z0-9]*(?![A-Za-z0-9_.:-])")
BLANKS = re.compile(r"(?:\s|\\\s)*")
# Distinguishes nested structures and caps from ranges, after the opening bracket.
NESTED = rf"\s*{NAME.pattern}\s*(?:[\];(]|,\s*(?:[\];]|{FIELD.pattern}\s*=))"
WORDS = ("ANY", "EMPTY", "NONE")
SYSTEM_MEMORY = "memory:SystemMemory"
DEPTH_LIMIT = 16
TEXT_LIMIT = 65_536
STRUCTURE_LIMIT = 512
MEMBER_LIMIT = 256
SHOWN_LENGTH = 400
CapsMaker = Callable[[tuple[Structure, ...] | None], NestedCaps]


class CapsReader:
    """A recursive-descent parser of one text.

    Args:
        text: caps, or one structure.
        make_caps: makes nested caps from structures, or from None for `ANY`.
        depth: nesting depth of the text in other caps.
        members: list members read so far, in the texts around this one.
    """

    def __init__(self, text: str, make_caps: CapsMaker, depth: int = 0, members: int = 0) -> None:
        self.text = text
        self.make_caps = make_caps
        self.depth = depth
        self.position = 0
        self.members = members
        if len(text) > TEXT_LIMIT:
            raise CapsSyntax(f"caps text of {len(text)} characters: at most {TEXT_LIMIT} are read")

    def error(self, rule: str, *, start: int | None = None, hint: str = "") -> CapsSyntax:
        """The error at the current position, or for the text from `start` up to it."""
        place = self.position if start is None else start
        shown = self.text if len(self.text) <= SHOWN_LENGTH else f"{self.text[:SHOWN_LENGTH]}..."
        message = f"caps {shown!r}, at character {place}: {rule}"
        return CapsSyntax(message, place, self.position - place, rule=rule, hint=hint)

    def skip_blanks(self) -> None:
        """Skips blanks."""
        match = BLANKS.match(self.text, self.position)
        self.position = match.end() if match else self.position

    def take(self, pattern: re.Pattern[str], what: str) -> str:
        """Reads one token, or fails with what was expected."""
        self.skip_blanks()
        match = pattern.match(self.text, self.position)
        if match is None:
            found = self.text[self.position : self.position + 12] or "the end"
            raise self.error(f"expected {what}, got {found!r}")
        self.position = match.end()
        return match.group()

    def accept(self, mark: str) -> bool:
        """Reads a punctuation mark, one character, if it is next."""
        self.skip_blanks()
        if self.text.startswith(mark, self.position):
            self.position += 1
            return True
        return False

    def is_before(self, marks: str) -> bool:
        """Whether the text ends, or one of the marks is next."""
        self.skip_blanks()
        return self.position >= len(self.text) or self.text[self.position] in marks

    def structures(self, closing: str = "") -> tuple[Structure, ...]:
        """Structures up to the closing mark or the end."""
        found: list[Structure] = []
        while True:
            found.append(self.structure())
            if len(found) > STRUCTURE_LIMIT:
                raise self.error(f"caps have at most {STRUCTURE_LIMIT} structures")
            more = self.accept(";")
            if self.accept_end(closing):
                return tuple(found)
            if not more:
                raise self.error("expected ',' or ';' between fields and structures")

    def only_structure(self, closing: str = "") -> Structure:
        """One structure up to the closing mark or the end."""
        found = self.structure()
        self.accept(";")
        if not self.accept_end(closing):
            raise self.error(f"expected {closing or 'the end'!r} after the structure {found.name!r}")
        return found

    def only_value(self) -> Value:
        """One value up to the end."""
        found = self.value(None)
        if not self.accept_end(""):
            raise self.error("expected the end after the value")
        return found

    def accept_end(self, closing: str) -> bool:
        """Reads the closing mark if it is next; without a mark, whether the text ends."""
        if closing:
            return self.accept(closing)
        self.skip_blanks()
        return self.position >= len(self.text)

    def structure(self) -> Structure:
        """Name, features and fields of one structure."""
        self.skip_blanks()
        start = self.position
        if self.text.startswith('"', start):
            name = UNESCAPED.sub(r"\1", self.take(QUOTED, "a closing quote")[1:-1])
            if not NAME.fullmatch(name):
                raise self.error(f"{name!r} is no media type such as video/x-raw", start=start)
        else:
            name = self.take(NAME, "a media type such as video/x-raw")
        if name in WORDS:
            raise self.error(f"{name} must be alone, without fields and other structures", start=start)
        features = self.features() if self.text.startswith("(", self.position) else ()
        fields: dict[str, Value] = {}
        while self.accept(","):
            if self.is_before(";]"):
                break
            field = self.take(FIELD, "a field name")
            if not self.accept("="):
                raise self.error(f"expected '=' after the field {field!r}")
            fields[field] = self.value(None)
        return Structure(name, fields, features)

    def features(self) -> tuple[str, ...]:
        """The unique features in parentheses; none for system memory only."""
        self.accept("(")
        if self.accept(")"):
            return ()
        names = [self.take(FEATURE, "a caps feature such as memory:DMABuf")]
        while self.accept(","):
            names.append(self.take(FEATURE, "a caps feature such as memory:DMABuf"))
        if not self.accept(")"):
            raise self.error("expected ')' after the caps features")
        found = tuple(dict.fromkeys(names))
        if "ANY" in found and len(found) > 1:
            raise self.error("the feature ANY must be alone")
        return () if found == (SYSTEM_MEMORY,) else found

    def value(self, kind: str | None) -> Value:
        """One value: simple, range, list, array or nested."""
        if self.accept("("):
            kind = self.type_name()
        self.skip_blanks()
        start = self.position
        mark = self.text[start : start + 1]
        if mark == '"':
            return self.simple(kind, self.take(QUOTED, "a closing quote"), start)
        if mark not in ("[", "{", "<"):
            return self.simple(kind, self.take(BARE, "a value"), start)
        self.position += 1
        self.depth += 1
        if self.depth > DEPTH_LIMIT:
            raise self.error(f"values nest at most {DEPTH_LIMIT} deep")
        try:
            if mark == "{":
                return ValueList(self.items(kind, "}"))
            if mark == "<":
                return ValueArray(self.items(kind, ">"))
            if kind in ("structure", "GstCaps") or (kind is None and self.is_nested()):
                return self.nested(kind)
            return self.range(kind, start)
        finally:
            self.depth -= 1

    def is_nested(self) -> bool:
        """Whether a structure, not a range, follows the opening bracket."""
        self.skip_blanks()
        if not self.text[self.position : self.position + 1].isalpha():
            return False
        return re.match(NESTED, self.text[self.position :]) is not None

    def type_name(self) -> str:
        """The type after an opening parenthesis."""
        name = self.take(BARE, "a type name")
        if name not in TYPES:
            import difflib  # slow to import

            near = difflib.get_close_matches(name, TYPES, 1)
            known = f"no type {name!r}; types are {', '.join(sorted(set(TYPES.values())))}"
            hint = f"did you mean {near[0]!r}?" if near else ""
            raise self.error(known, start=self.position - len(name), hint=hint)
        if not self.accept(")"):
            raise self.error("expected ')' after the type name")
        return TYPES[name]

    def items(self, kind: str | None, closing: str) -> tuple[Value, ...]:
        """Members of a list or array up to its closing mark; leading and trailing commas are allowed."""
        found: list[Value] = []
        self.accept(",")
        while not self.accept(closing):
            found.append(self.value(kind))
            if not self.accept(","):
                if not self.accept(closing):
                    raise self.error(f"expected ',' or '{closing}'")
                break
        if any(type(item) not in SCALARS for item in found):
            self.members += len(found)
            if self.members > MEMBER_LIMIT:
                raise self.error(
                    f"lists that hold more than plain values have at most {MEMBER_LIMIT} members"
                )
        return tuple(found)

    def range(self, kind: str | None, start: int) -> Range[Any]:
        """A range after its opening bracket."""
        parts = [self.value(kind)]
        while self.accept(","):
            parts.append(self.value(kind))
        if not self.accept("]"):
            raise self.error("expected ',' or ']'")
        if len(parts) not in (2, 3):
            raise self.error(f"a range has two ends and at most a step, got {len(parts)} values", start=start)
        try:
            return make_range(parts)
        except (ValueError, TypeError) as error:
            raise self.error(str(error), start=start) from None

    def nested(self, kind: str | None) -> NestedStructure | NestedCaps:
        """A structure or caps after the opening bracket."""
        if kind == "structure":
            return self.only_structure("]")
        before = self.position
        if kind == "GstCaps":
            word = next((word for word in WORDS if self.text.startswith(word, before)), None)
            if word is not None:
                self.position += len(word)
                if self.accept("]"):
                    return self.make_caps(None if word == "ANY" else ())
                self.position = before
            return self.make_caps(self.structures("]"))
        self.take(NAME, "a media type")
        features = self.text.startswith("(", self.position)
        self.position = before
        return self.make_caps(self.structures("]")) if features else self.only_structure("]")

    def simple(self, kind: str | None, raw: str, start: int) -> Value:
        """A simple value of the given type, or of the first type that fits."""
        if kind in ("structure", "GstCaps"):
            return self.nested_text(kind, raw, start)
        if kind is None:
            text = UNESCAPED.sub(r"\1", raw[1:-1]) if raw[0] == '"' else raw
            value = read_untyped(text, raw)
        else:
            value = READERS[kind](raw)
        if value is None:
            kind = kind or ("string" if raw[0] == '"' else "fraction" if "/" in raw else "double")
            raise self.error(f"{raw!r} is no value of type {kind}", start=start)
        return value

    def nested_text(self, kind: str, raw: str, start: int) -> NestedStructure | NestedCaps:
        """A structure or caps written as a string or a bare name."""
        if self.depth >= DEPTH_LIMIT:
            raise self.error(f"values nest at most {DEPTH_LIMIT} deep", start=start)
        text = read_string(raw)
        if text is None:
            raise self.error(f"{raw!r} is no string", start=start)
        if kind == "GstCaps" and text in WORDS:
            return self.make_caps(None if text == "ANY" else ())
        reader = CapsReader(text, self.make_caps, self.depth + 1, self.members)
        try:
            found = reader.only_structure() if kind == "structure" else self.make_caps(reader.structures())
        except CapsSyntax as error:
            raise self.error(f"no {kind}: {error.rule}", start=start, hint=error.hint) from None
        self.members = reader.members
        return found


def make_range(parts: list[Value]) -> Range[Any]:
    """Makes a range from its ends and step; raises `TypeError` or `ValueError` with the rule."""
    for end in parts[:2]:
        if not isinstance(end, int | float | Fraction) or isinstance(end, bool):
            raise TypeError(f"a range's ends must be numbers, got {end!r}")
    if len(parts) == 3 and type(parts[2]) not in (int, Int64):
        raise TypeError(f"a range's step must be an integer, got {parts[2]!r}")
    if len({type(part) for part in parts}) > 1:
        shown = ", ".join(str(part) for part in parts)
        raise TypeError(f"a range's parts must be of one type, got [ {shown} ]; write the type in front")
    low, high, *rest = parts
    kind: Any = {
        int: IntRange, Int64: Int64Range, float: FloatRange, Fraction: FractionRange,
    }.get(type(low))  # fmt: skip
    if kind is None:
        raise TypeError("ranges are of int, gint64, double or fraction")
    found: Range[Any] = kind(low, high, *(int(step) for step in rest if isinstance(step, int)))
    return found
