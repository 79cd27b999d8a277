"""Parser of caps: structures with features and fields; values, ranges, lists, nested caps.

Source: the caps syntax of GStreamer's documentation ("Appendices: caps syntax").
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Any

from streamkit.errors import CapsSyntax, did_you_mean
from streamkit.flow.caps_algebra import Structure
from streamkit.flow.caps_text import READERS, TYPES, read_string, read_untyped
from streamkit.flow.caps_values import (
    SCALARS,
    FloatRange,
    FractionRange,
    Int64,
    Int64Range,
    IntRange,
    Nested,
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
WORDS = ("ANY", "EMPTY", "NONE")
ONLY_WORD = re.compile(rf"\s*({'|'.join(WORDS)})\s*(?=\]|$)")
# Distinguishes nested structures and caps, which have features, from ranges, after the opening bracket.
NESTED = re.compile(rf"\s*{NAME.pattern}(?:(?P<features>\()|\s*(?:[\];(]|,\s*(?:[\];]|{FIELD.pattern}\s*=)))")
SYSTEM_MEMORY = "memory:SystemMemory"
DEPTH_LIMIT = 16
TEXT_LIMIT = 65_536
STRUCTURE_LIMIT = 512
MEMBER_LIMIT = 256
SHOWN_LENGTH = 400
RANGES: dict[type, Any] = {int: IntRange, Int64: Int64Range, float: FloatRange, Fraction: FractionRange}


class CapsReader:
    """A recursive-descent parser of one text.

    Args:
        text: caps, or one structure.
        depth: nesting depth of the text in other caps.
        members: list members read so far, in the texts around this one.
    """

    def __init__(self, text: str, depth: int = 0, members: int = 0) -> None:
        self.text = text
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

    def next_mark(self) -> str:
        """The next character that is no blank; "" at the end."""
        blanks = BLANKS.match(self.text, self.position)
        self.position = blanks.end() if blanks else self.position
        return self.text[self.position : self.position + 1]

    def take(self, pattern: re.Pattern[str], what: str) -> str:
        """Reads one token, or fails with what was expected."""
        self.next_mark()
        match = pattern.match(self.text, self.position)
        if match is None:
            found = self.text[self.position : self.position + 12] or "the end"
            raise self.error(f"expected {what}, got {found!r}")
        self.position = match.end()
        return match.group()

    def accept(self, mark: str) -> bool:
        """Reads a punctuation mark if it is next; "" is the end."""
        if self.next_mark() != mark:
            return False
        self.position += len(mark)
        return True

    def caps(self, closing: str = "") -> tuple[bool, tuple[Structure, ...]]:
        """Caps up to the closing mark or the end: whether they are ANY, and their structures."""
        if word := ONLY_WORD.match(self.text, self.position):
            self.position = word.end()
            if self.accept(closing):
                return word[1] == "ANY", ()
            self.position = word.start()
        return False, self.structures(closing)

    def structures(self, closing: str = "") -> tuple[Structure, ...]:
        """Structures up to the closing mark or the end."""
        found: list[Structure] = []
        while True:
            found.append(self.structure())
            if len(found) > STRUCTURE_LIMIT:
                raise self.error(f"caps have at most {STRUCTURE_LIMIT} structures")
            more = self.accept(";")
            if self.accept(closing):
                return tuple(found)
            if not more:
                raise self.error("expected ',' or ';' between fields and structures")

    def only_value(self) -> Value:
        """One value up to the end."""
        found = self.value(None)
        if not self.accept(""):
            raise self.error("expected the end after the value")
        return found

    def structure(self) -> Structure:
        """Name, features and fields of one structure."""
        mark, start = self.next_mark(), self.position
        if mark == '"':
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
            if self.next_mark() in ("", ";", "]"):
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
        mark, start = self.next_mark(), self.position
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
            if kind is None and (nested := NESTED.match(self.text, self.position)):
                kind = "GstCaps" if nested["features"] else "structure"
            return self.nested(kind, "]") if kind in ("structure", "GstCaps") else self.range(kind, start)
        finally:
            self.depth -= 1

    def type_name(self) -> str:
        """The type after an opening parenthesis."""
        name = self.take(BARE, "a type name")
        if name not in TYPES:
            known = f"no type {name!r}; types are {', '.join(sorted(set(TYPES.values())))}"
            raise self.error(known, start=self.position - len(name), hint=did_you_mean(name, TYPES))
        if not self.accept(")"):
            raise self.error("expected ')' after the type name")
        return TYPES[name]

    def items(self, kind: str | None, closing: str) -> tuple[Value, ...]:
        """Members of a list or array up to its closing mark; leading and trailing commas are allowed."""
        found: list[Value] = []
        self.accept(",")
        while not self.accept(closing):
            found.append(self.value(kind))
            if not self.accept(",") and self.next_mark() != closing:
                raise self.error(f"expected ',' or '{closing}'")
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
        try:
            return make_range(parts)
        except (ValueError, TypeError) as error:
            raise self.error(str(error), start=start) from None

    def nested(self, kind: str | None, closing: str = "") -> Nested:
        """A structure or caps up to the closing mark or the end."""
        if kind == "GstCaps":
            from streamkit.flow.caps import ANY, Caps  # whose texts this class reads

            is_any, structures = self.caps(closing)
            return ANY if is_any else Caps(structures)
        found, *more = self.structures(closing)
        if more:
            raise self.error("a value holds one structure; write (GstCaps) in front for caps")
        return found

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

    def nested_text(self, kind: str, raw: str, start: int) -> Nested:
        """A structure or caps written as a string or a bare name."""
        if self.depth >= DEPTH_LIMIT:
            raise self.error(f"values nest at most {DEPTH_LIMIT} deep", start=start)
        text = read_string(raw)
        if text is None:
            raise self.error(f"{raw!r} is no string", start=start)
        reader = CapsReader(text, self.depth + 1, self.members)
        try:
            found = reader.nested(kind)
        except CapsSyntax as error:
            raise self.error(f"no {kind}: {error.rule}", start=start, hint=error.hint) from None
        self.members = reader.members
        return found


def make_range(parts: list[Value]) -> Range[Any]:
    """Makes a range from its ends and step; raises `TypeError` or `ValueError` with the rule."""
    if len(parts) not in (2, 3):
        raise ValueError(f"a range has two ends and at most a step, got {len(parts)} values")
    for end in parts[:2]:
        if not isinstance(end, int | float | Fraction) or isinstance(end, bool):
            raise TypeError(f"a range's ends must be numbers, got {end!r}")
    if len(parts) == 3 and type(parts[2]) not in (int, Int64):
        raise TypeError(f"a range's step must be an integer, got {parts[2]!r}")
    kinds = set(map(type, parts))
    if len(kinds) > 1:
        shown = ", ".join(map(str, parts))
        raise TypeError(f"a range's parts must be of one type, got [ {shown} ]; write the type in front")
    kind = RANGES.get(kinds.pop())
    if kind is None:
        raise TypeError("ranges are of int, gint64, double or fraction")
    found: Range[Any] = kind(*parts[:2], *map(int, parts[2:]))  # type: ignore[arg-type]  # checked above
    return found
