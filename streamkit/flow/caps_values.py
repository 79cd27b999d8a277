"""Values of caps fields and their text: numbers of all widths, ranges, lists, arrays, flag sets, nested caps.

Python's int (32 bits), float (double), bool, str, bytes (buffer), Fraction and date are GStreamer's common
types. The other types are small classes: values of different types are never equal.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Generic, TypeVar

INT_MIN, INT_MAX = -(2**31), 2**31 - 1
FRACTION_MAX = Fraction(INT_MAX, 1)
FULL_MASK = 0xFFFFFFFF
Number = TypeVar("Number", int, float, Fraction)
PLAIN = re.compile(r"[A-Za-z0-9_+/:.-]+")
OTHER = re.compile(rb"[^A-Za-z0-9_+/:.-]")


class Int64(int):
    """A signed integer of 64 bits."""


class UInt(int):
    """An unsigned integer of 32 bits."""


class UInt64(int):
    """An unsigned integer of 64 bits."""


class Long(int):
    """C's long, 64 bits."""


class ULong(int):
    """C's unsigned long, 64 bits."""


class UChar(int):
    """An unsigned integer of 8 bits."""


class Bitmask(int):
    """64 bits, such as an audio channel mask."""


class Float32(float):
    """A float of 32 bits."""


class NullText(str):
    """A null string, written `NULL`."""


class DateTime(str):
    """An ISO 8601 date and time, from the year down to fractions of a second."""


@dataclass(frozen=True, slots=True)
class Range(Generic[Number]):
    """Numbers of one type from `low` to `high`, both included."""

    low: Number
    high: Number

    number: ClassVar[type[Any]]

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"a range's low end must be below its high end, got [ {self.low}, {self.high} ]")

    def __contains__(self, value: Any) -> bool:
        """Whether the value has the range's type and lies in the range."""
        return type(value) is self.number and self.low <= value <= self.high


class FloatRange(Range[float]):
    """Floats (doubles) from `low` to `high`, both included."""

    number = float


class FractionRange(Range[Fraction]):
    """Fractions from `low` to `high`, both included; exact."""

    number = Fraction


@dataclass(frozen=True, slots=True)
class IntRange(Range[int]):
    """Integers from `low` to `high`, both included, that are multiples of `step`."""

    step: int = 1

    number = int

    def __post_init__(self) -> None:
        if self.step < 1:
            raise ValueError(f"a range's step must be at least 1, got {self.step}")
        Range.__post_init__(self)
        if self.low % self.step or self.high % self.step:
            raise ValueError(f"a range's ends must be multiples of its step {self.step}")

    def __contains__(self, value: Any) -> bool:
        """Whether the integer has the range's type and is a multiple of `step` in the range."""
        return type(value) is self.number and self.low <= value <= self.high and value % self.step == 0


class Int64Range(IntRange):
    """64-bit integers from `low` to `high`, both included, that are multiples of `step`."""

    number = Int64


@dataclass(frozen=True, slots=True)
class FlagSet:
    """32 flags: those in `mask` have the values in `flags`, the others are undecided."""

    flags: int
    mask: int

    names: ClassVar[Mapping[int, str]] = MappingProxyType({})

    def __post_init__(self) -> None:
        if not (0 <= self.flags <= FULL_MASK and 0 <= self.mask <= FULL_MASK):
            raise ValueError(f"flags and mask have 32 bits, got {self.flags:x}:{self.mask:x}")
        object.__setattr__(self, "flags", self.flags & self.mask)


class MultiviewFlags(FlagSet):
    """Layout of the views of stereoscopic video, as in the caps of decoders."""

    names: ClassVar[Mapping[int, str]] = MappingProxyType(
        {
            0x1: "right-view-first",
            0x2: "left-flipped",
            0x4: "left-flopped",
            0x8: "right-flipped",
            0x10: "right-flopped",
            0x4000: "half-aspect",
            0x8000: "mixed-mono",
        }
    )


@dataclass(frozen=True)
class ValueList:
    """Alternatives, the preferred one first."""

    items: tuple[Value, ...]

    @cached_property
    def scalars(self) -> frozenset[tuple[type, Value]]:
        """The alternatives that are scalars, with their types: a list may have thousands of them."""
        return frozenset((type(item), item) for item in self.items if type(item) in SCALARS)

    @cached_property
    def others(self) -> tuple[Value, ...]:
        """The alternatives that are no scalars."""
        return tuple(item for item in self.items if type(item) not in SCALARS)


@dataclass(frozen=True, slots=True)
class ValueArray:
    """An ordered sequence; arrays intersect element by element."""

    items: tuple[Value, ...]


class Nested:
    """Base of structures and caps, which may be values of fields themselves.

    Caps are one opaque value there, whatever they allow, as in GStreamer.
    """

    __slots__ = ()
    type_name: ClassVar[str]


Simple = bool | int | float | str | bytes | Fraction | date | FlagSet


Value = Simple | Range[Any] | ValueList | ValueArray | Nested


# GStreamer's names of the types; a range has the name of its ends.
TYPE_NAMES: dict[type, str] = {
    bool: "boolean", int: "int", IntRange: "int", UInt: "uint", Int64: "gint64", Int64Range: "gint64",
    UInt64: "guint64", Long: "glong", ULong: "gulong", UChar: "guchar", float: "double",
    FloatRange: "double", Float32: "float", Fraction: "fraction", FractionRange: "fraction", str: "string",
    NullText: "string", bytes: "buffer", date: "date", DateTime: "datetime", Bitmask: "bitmask",
    FlagSet: "flagset", MultiviewFlags: "GstVideoMultiviewFlagsSet",
}  # fmt: skip


# Types whose values intersect only if they are equal; type and hash tell any two of them apart.
SCALARS = frozenset(kind for kind in TYPE_NAMES if not issubclass(kind, Range | FlagSet))


def type_name(value: Value) -> str:
    """GStreamer's name of the type of a value, or of the first member of a list or array."""
    if isinstance(value, ValueList | ValueArray):
        return type_name(value.items[0]) if value.items else "int"
    if isinstance(value, Nested):
        return value.type_name
    name = TYPE_NAMES.get(type(value))
    return name or next((name for kind, name in TYPE_NAMES.items() if isinstance(value, kind)), "string")


def write_structure(name: str, features: Iterable[str], fields: Mapping[str, Value]) -> str:
    """`name(features), field=(type)value, ...`."""
    marks = ", ".join(features)
    parts = [f"{name}({marks})" if marks else name]
    parts += [f"{key}={write_value(value)}" for key, value in fields.items()]
    return ", ".join(parts)


def write_value(value: Value) -> str:
    """A value with its type; members of a list or array have their own types if these differ."""
    if isinstance(value, ValueList | ValueArray) and len({type_name(item) for item in value.items}) > 1:
        return write_members(value, typed=True)
    return f"({type_name(value)}){write_plain(value)}"


def write_members(value: ValueList | ValueArray, *, typed: bool) -> str:
    """A list or array in its brackets."""
    opening, closing = ("{", "}") if isinstance(value, ValueList) else ("<", ">")
    members: list[str] = []
    for item in value.items:
        if isinstance(item, ValueList | ValueArray):
            # As in GStreamer, members of an inner list have their types.
            members.append(write_members(item, typed=True))
        else:
            members.append(write_value(item) if typed else write_plain(item))
    return f"{opening} {', '.join(members)} {closing}"


def write_plain(value: Value) -> str:
    """A value without its type."""
    if isinstance(value, ValueList | ValueArray):
        return write_members(value, typed=False)
    if isinstance(value, IntRange):
        step = f", {value.step}" if value.step != 1 else ""
        return f"[ {value.low}, {value.high}{step} ]"
    if isinstance(value, Range):
        return f"[ {write_plain(value.low)}, {write_plain(value.high)} ]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Bitmask):
        return f"0x{int(value):016x}"
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        return f"{float(value):.17g}"
    if isinstance(value, Fraction):
        return f"{value.numerator}/{value.denominator}"
    if isinstance(value, str):
        return str(value) if isinstance(value, NullText | DateTime) else write_string(value)
    if isinstance(value, bytes):
        return value.hex() or '""'
    if isinstance(value, FlagSet):
        names = ((bit, name) for bit, name in value.names.items() if value.mask & bit)
        marks = "".join(("+" if value.flags & bit else "/") + name for bit, name in names)
        return f"{value.flags:x}:{value.mask:x}" + (f":{marks}" if marks else "")
    if isinstance(value, Nested):
        return f"[{value};]" if value.type_name == "structure" else f"[{value}]"
    return str(value)


def write_string(text: str) -> str:
    """A string, quoted and escaped if it has characters that names do not have."""
    if PLAIN.fullmatch(text) and text != "NULL":
        return text

    def escaped(match: re.Match[bytes]) -> bytes:
        byte = match.group()
        return b"\\" + byte if 0x20 <= byte[0] < 0x7F else b"\\%03o" % byte[0]

    return f'"{OTHER.sub(escaped, text.encode("utf-8", "surrogatepass")).decode()}"'
