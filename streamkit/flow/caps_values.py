"""Values of caps fields: numbers of every width, ranges, lists, arrays, flag sets, nested caps.

Plain Python values stand for GStreamer's commonest types: int (32 bits), float (double), bool, str, bytes
(buffer), Fraction, date. The other types are small classes, so that a value keeps its type through every
operation: two values of different types are never equal, whatever Python says.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from fractions import Fraction
from types import MappingProxyType
from typing import ClassVar

INT_MIN, INT_MAX = -(2**31), 2**31 - 1
INT64_MIN, INT64_MAX = -(2**63), 2**63 - 1
FRACTION_MAX = Fraction(INT_MAX, 1)
FULL_MASK = 0xFFFFFFFF


class Int64(int):
    """A signed integer of 64 bits."""

    __slots__ = ()


class UInt(int):
    """An unsigned integer of 32 bits."""

    __slots__ = ()


class UInt64(int):
    """An unsigned integer of 64 bits."""

    __slots__ = ()


class Long(int):
    """A signed integer of C's type long, 64 bits."""

    __slots__ = ()


class ULong(int):
    """An unsigned integer of C's type unsigned long, 64 bits."""

    __slots__ = ()


class UChar(int):
    """An unsigned integer of 8 bits."""

    __slots__ = ()


class Bitmask(int):
    """64 bits without an order, such as an audio channel mask."""

    __slots__ = ()


class Float32(float):
    """A float of 32 bits."""

    __slots__ = ()


class NullText(str):
    """The string that is not there, written `NULL`."""

    __slots__ = ()


class DateTime(str):
    """A point of time in ISO 8601, from the year alone down to fractions of a second."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class IntRange:
    """Integers from `low` to `high`, both included, that are multiples of `step`."""

    low: int
    high: int
    step: int = 1

    number: ClassVar[type[int]] = int

    def __post_init__(self) -> None:
        if self.step < 1:
            raise ValueError(f"a range's step must be at least 1, got {self.step}")
        if self.low >= self.high:
            raise ValueError(f"a range's low end must be below its high end, got [ {self.low}, {self.high} ]")
        if self.low % self.step or self.high % self.step:
            raise ValueError(f"a range's ends must be multiples of its step {self.step}")

    def __contains__(self, value: object) -> bool:
        """Whether the integer is of the range's width, lies in the range and on its step."""
        return type(value) is self.number and self.low <= value <= self.high and value % self.step == 0


class Int64Range(IntRange):
    """64-bit integers from `low` to `high`, both included, that are multiples of `step`."""

    __slots__ = ()
    number: ClassVar[type[int]] = Int64


@dataclass(frozen=True, slots=True)
class FloatRange:
    """Floats (doubles) from `low` to `high`, both included."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"a range's low end must be below its high end, got [ {self.low}, {self.high} ]")

    def __contains__(self, value: object) -> bool:
        """Whether the float lies in the range."""
        return type(value) is float and self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class FractionRange:
    """Fractions from `low` to `high`, both included; exact."""

    low: Fraction
    high: Fraction

    def __post_init__(self) -> None:
        if self.low >= self.high:
            raise ValueError(f"a range's low end must be below its high end, got [ {self.low}, {self.high} ]")

    def __contains__(self, value: object) -> bool:
        """Whether the fraction lies in the range."""
        return isinstance(value, Fraction) and self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class FlagSet:
    """32 flags of which only those in `mask` are decided; all others may be either."""

    flags: int
    mask: int

    names: ClassVar[Mapping[int, str]] = MappingProxyType({})

    def __post_init__(self) -> None:
        if not (0 <= self.flags <= FULL_MASK and 0 <= self.mask <= FULL_MASK):
            raise ValueError(f"flags and mask have 32 bits, got {self.flags:x}:{self.mask:x}")
        object.__setattr__(self, "flags", self.flags & self.mask)


class MultiviewFlags(FlagSet):
    """How the views of stereoscopic video lie in a frame, as decoders write it into their caps."""

    __slots__ = ()
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


@dataclass(frozen=True, slots=True)
class ValueList:
    """Alternatives, the preferred one first."""

    items: tuple[Value, ...]


@dataclass(frozen=True, slots=True)
class ValueArray:
    """An ordered sequence; arrays meet element by element."""

    items: tuple[Value, ...]


class NestedValue(ABC):
    """A value that has fields itself: a structure, or whole caps."""

    __slots__ = ()

    @property
    @abstractmethod
    def nested_fixed(self) -> bool:
        """Whether it counts as one value."""

    @abstractmethod
    def nested_equal(self, other: NestedValue) -> bool:
        """Whether both are the same value."""

    @abstractmethod
    def nested_meet(self, other: NestedValue) -> NestedValue | None:
        """What both allow, or None."""

    @abstractmethod
    def nested_join(self, other: NestedValue) -> NestedValue | None:
        """One value that allows what either allows, or None where a list is needed."""

    @abstractmethod
    def nested_within(self, other: NestedValue) -> bool:
        """Whether everything it allows is allowed by the other."""

    @abstractmethod
    def nested_fixate(self) -> NestedValue:
        """One value out of what it allows."""


Range = IntRange | FloatRange | FractionRange
RANGES = (IntRange, Int64Range, FloatRange, FractionRange)
Simple = bool | int | float | str | bytes | Fraction | date | FlagSet
Value = Simple | Range | ValueList | ValueArray | NestedValue


def is_fixed(value: Value) -> bool:
    """Whether a value is one value and not a choice."""
    if isinstance(value, (*RANGES, ValueList)):
        return False
    if isinstance(value, ValueArray):
        return all(is_fixed(item) for item in value.items)
    if isinstance(value, FlagSet):
        return value.mask == FULL_MASK
    return value.nested_fixed if isinstance(value, NestedValue) else True
