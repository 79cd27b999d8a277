"""Text form of caps, read and written.

Source: the caps syntax of GStreamer's documentation ("Appendices: caps syntax").
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any, TypeVar

from streamkit.errors import CapsSyntax
from streamkit.flow.caps_values import (
    FRACTION_MAX,
    INT_MAX,
    INT_MIN,
    FloatRange,
    FractionRange,
    IntRange,
    Range,
    Value,
    ValueArray,
    ValueList,
)

NAME = re.compile(r"[A-Za-z][A-Za-z0-9/_.:+*-]*")
FIELD = re.compile(r"[A-Za-z0-9_][A-Za-z0-9/_.:+-]*")
BARE = re.compile(r"[A-Za-z0-9_+/:.*-]+")
QUOTED = re.compile(r'"((?:[^"\\]|\\.)*)"', re.DOTALL)
FEATURE = re.compile(r"[A-Za-z]+(?::[A-Za-z0-9_-]+)?")
BLANKS = re.compile(r"(?:\s|\\ )*")
INTEGER = re.compile(r"[+-]?(?:0[xX][0-9A-Fa-f]{1,40}|0[0-7]{0,40}|[1-9][0-9]{0,40})")
FLOAT = re.compile(r"[+-]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+)(?:[eE][+-]?[0-9]+)?")
FRACTION = re.compile(r"([+-]?[0-9]{1,40})/([0-9]{1,40})")
WHOLE = re.compile(r"[+-]?[0-9]{1,40}")
PLAIN = re.compile(r"[A-Za-z0-9_+/:.*-]+")
TYPES = {
    "i": "int", "int": "int", "uint": "int", "int64": "int", "uint64": "int", "gint64": "int",
    "guint64": "int",
    "f": "double", "float": "double", "d": "double", "double": "double", "b": "boolean", "bool": "boolean",
    "boolean": "boolean", "s": "string", "str": "string", "string": "string", "fraction": "fraction",
    "buffer": "buffer", "bitmask": "int",
}  # fmt: skip
DEPTH_LIMIT = 16
Number = TypeVar("Number", int, float, Fraction)
StructureText = tuple[str, tuple[str, ...], dict[str, Value]]


class CapsReader:
    """Reads one caps text, left to right."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.position = 0

    def fail(self, rule: str) -> CapsSyntax:
        """The error for the place where reading stands."""
        return CapsSyntax(f"caps {self.text!r}, at character {self.position}: {rule}", position=self.position)

    def skip_blanks(self) -> None:
        """Moves over blanks."""
        match = BLANKS.match(self.text, self.position)
        self.position = match.end() if match else self.position

    def take(self, pattern: re.Pattern[str], what: str) -> re.Match[str]:
        """Reads one token or fails, naming what was wanted."""
        self.skip_blanks()
        match = pattern.match(self.text, self.position)
        if match is None:
            found = self.text[self.position : self.position + 12] or "the end"
            raise self.fail(f"expected {what}, got {found!r}")
        self.position = match.end()
        return match

    def accept(self, mark: str) -> bool:
        """Reads a punctuation mark if it is next."""
        self.skip_blanks()
        if self.text.startswith(mark, self.position):
            self.position += len(mark)
            return True
        return False

    def structures(self) -> list[StructureText]:
        """All structures up to the end of the text."""
        found: list[StructureText] = []
        while True:
            found.append(self.structure())
            more = self.accept(";")
            self.skip_blanks()
            if self.position == len(self.text):
                return found
            if not more:
                raise self.fail("expected ',' or ';' between fields and structures")

    def structure(self) -> StructureText:
        """Name, features and fields of one structure."""
        name = self.take(NAME, "a media type such as video/x-raw").group()
        features: tuple[str, ...] = ()
        if self.accept("("):
            names = [self.take(FEATURE, "a caps feature such as memory:DMABuf").group()]
            while self.accept(","):
                names.append(self.take(FEATURE, "a caps feature").group())
            if not self.accept(")"):
                raise self.fail("expected ')' after the caps features")
            features = tuple(sorted({name for name in names if name != "memory:SystemMemory"}))
        fields: dict[str, Value] = {}
        while self.accept(","):
            self.skip_blanks()
            if self.position == len(self.text) or self.text[self.position] == ";":
                break
            field = self.take(FIELD, "a field name").group()
            if not self.accept("="):
                raise self.fail(f"expected '=' after the field {field!r}")
            fields[field] = self.value(None, 0)
        return name, features, fields

    def value(self, kind: str | None, depth: int) -> Value:
        """One value: simple, range, list or array."""
        if depth > DEPTH_LIMIT:
            raise self.fail(f"values nest at most {DEPTH_LIMIT} deep")
        if self.accept("("):
            name = self.take(NAME, "a type name").group()
            if name not in TYPES:
                raise self.fail(f"no type {name!r}; types are {', '.join(sorted(set(TYPES)))}")
            kind = TYPES[name]
            if not self.accept(")"):
                raise self.fail("expected ')' after the type name")
        if self.accept("["):
            return self.range(kind, depth)
        if self.accept("{"):
            return ValueList(self.items(kind, "}", depth))
        if self.accept("<"):
            return ValueArray(self.items(kind, ">", depth))
        self.skip_blanks()
        if self.text.startswith('"', self.position):
            text = re.sub(r"\\(.)", r"\1", self.take(QUOTED, "a closing quote").group(1), flags=re.DOTALL)
            return text if kind in (None, "string") else self.typed(kind, text)
        return self.typed(kind, self.take(BARE, "a value").group())

    def items(self, kind: str | None, closing: str, depth: int) -> tuple[Value, ...]:
        """The members of a list or array up to its closing mark."""
        found: list[Value] = []
        if self.accept(","):
            if self.accept(closing):
                return ()
            raise self.fail("expected a value before ','")
        while not self.accept(closing):
            found.append(self.value(kind, depth + 1))
            if not self.accept(","):
                if not self.accept(closing):
                    raise self.fail(f"expected ',' or '{closing}'")
                break
        return tuple(found)

    def range(self, kind: str | None, depth: int) -> Range:
        """A range after its opening bracket."""
        parts = self.items(kind, "]", depth)
        if len(parts) not in (2, 3):
            raise self.fail(f"a range has two ends and at most a step, got {len(parts)} values")
        try:
            return make_range(parts)
        except (ValueError, TypeError) as error:
            raise self.fail(str(error)) from None

    def typed(self, kind: str | None, text: str) -> Value:
        """A simple value of a given type, or of the first type that fits."""
        value = read_simple(kind, text)
        if value is None:
            raise self.fail(f"{text!r} is no value of type {kind or 'double'}")
        return value


def make_range(parts: tuple[Value, ...]) -> Range:
    """A range out of its two ends and step; `min` and `max` stand for the type's limits."""
    low, high, *rest = parts
    if any(isinstance(end, Fraction) for end in (low, high)):
        return FractionRange(
            _limit(low, -FRACTION_MAX, Fraction),
            _limit(high, FRACTION_MAX, Fraction),
        )
    if any(isinstance(end, float) for end in (low, high)):
        return FloatRange(
            _limit(low, -1.7976931348623157e308, float), _limit(high, 1.7976931348623157e308, float)
        )
    step = rest[0] if rest else 1
    if not isinstance(step, int):
        raise TypeError(f"a range's step must be an integer, got {step!r}")
    return IntRange(_limit(low, INT_MIN, int), _limit(high, INT_MAX, int), step)


def _limit(end: Value, default: Number, kind: Callable[[Any], Number]) -> Number:
    if isinstance(end, str) and end.lower() in ("min", "max"):
        return default
    if isinstance(end, bool) or not isinstance(end, int | float | Fraction):
        raise TypeError(f"a range's ends must be numbers, got {end!r}")
    return kind(end)


def read_integer(text: str) -> int | None:
    """An integer in C notation (0x hexadecimal, leading 0 octal), or None."""
    if not INTEGER.fullmatch(text):
        return None
    digits = text.lstrip("+-")
    base = 16 if digits[:2] in ("0x", "0X") else 8 if len(digits) > 1 and digits[0] == "0" else 10
    return int(text, base)


def read_fraction(text: str) -> Fraction | None:
    """A fraction `n/d` or whole number, or None."""
    match = FRACTION.fullmatch(text)
    if match:
        return Fraction(int(match[1]), int(match[2])) if int(match[2]) else None
    if text.lower() == "max":
        return FRACTION_MAX
    return Fraction(int(text)) if WHOLE.fullmatch(text) else None


def read_float(text: str) -> float | None:
    """A finite number, or None."""
    value = float(text) if FLOAT.fullmatch(text) else math.inf
    return value if math.isfinite(value) else None


def read_boolean(text: str) -> bool | None:
    """A boolean in any of GStreamer's spellings, or None."""
    word = text.lower()
    return True if word in ("true", "yes", "t", "1") else False if word in ("false", "no", "f", "0") else None


def read_simple(kind: str | None, text: str) -> Value | None:
    """A simple value of the type `kind`; without a type int, double, fraction, boolean, string are tried."""
    if kind == "string":
        return text
    if kind == "buffer":
        return bytes.fromhex(text) if re.fullmatch(r"(?:[0-9A-Fa-f]{2})*", text) else None
    if kind in (None, "int"):
        number = read_integer(text)
        if number is not None or kind == "int":
            word = text.lower()
            return word if word in ("min", "max") else number
    if kind == "double" or (kind is None and FLOAT.fullmatch(text)):
        word = text.lower()
        return word if word in ("min", "max") else read_float(text)
    if kind == "fraction" or (kind is None and "/" in text):
        fraction = read_fraction(text)
        if fraction is not None or kind == "fraction":
            return fraction
    truth = read_boolean(text)
    if kind == "boolean" or (truth is not None and not text.isdigit()):
        return truth
    return text


def write_value(value: Value, *, typed: bool = True) -> str:
    """The text of a value, with its type in front where `typed`."""
    if isinstance(value, ValueList | ValueArray):
        opening, closing = ("{", "}") if isinstance(value, ValueList) else ("<", ">")
        kinds = {type_name(item) for item in value.items}
        inner = ", ".join(write_value(item, typed=len(kinds) > 1) for item in value.items)
        text = f"{opening} {inner} {closing}" if inner else f"{opening} {closing}"
        return f"({kinds.pop()}){text}" if typed and len(kinds) == 1 else text
    text = _write_plain(value)
    return f"({type_name(value)}){text}" if typed else text


def _write_plain(value: Value) -> str:
    if isinstance(value, IntRange):
        step = f", {value.step}" if value.step != 1 else ""
        return f"[ {value.low}, {value.high}{step} ]"
    if isinstance(value, FloatRange | FractionRange):
        return f"[ {_write_plain(value.low)}, {_write_plain(value.high)} ]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, bytes):
        return value.hex() or '""'
    if isinstance(value, Fraction):
        return f"{value.numerator}/{value.denominator}"
    if isinstance(value, str) and not PLAIN.fullmatch(value):
        return '"' + re.sub(r"([^A-Za-z0-9_+/:.-])", r"\\\1", value) + '"'
    return str(value)


def type_name(value: Value) -> str:
    """GStreamer's name of a value's type."""
    if isinstance(value, ValueList | ValueArray):
        return type_name(value.items[0]) if value.items else "list"
    for kinds, name in (
        (bool, "boolean"),
        (int | IntRange, "int"),
        (float | FloatRange, "double"),
        (Fraction | FractionRange, "fraction"),
        (bytes, "buffer"),
    ):
        if isinstance(value, kinds):
            return name
    return "string"
