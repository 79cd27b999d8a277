"""Values of caps fields: ranges, lists and arrays, with intersection, subset and fixation.

Source: GStreamer's documentation of caps and its value functions (results, not code).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeGuard

INT_MIN, INT_MAX = -(2**31), 2**31 - 1
FRACTION_MAX = Fraction(INT_MAX, 1)


@dataclass(frozen=True, slots=True)
class IntRange:
    """Integers from `low` to `high`, both included, that are multiples of `step`."""

    low: int
    high: int
    step: int = 1

    def __post_init__(self) -> None:
        if self.step < 1:
            raise ValueError(f"a range's step must be at least 1, got {self.step}")
        if self.low >= self.high:
            raise ValueError(f"a range's low end must be below its high end, got [ {self.low}, {self.high} ]")
        if self.low % self.step or self.high % self.step:
            raise ValueError(f"a range's ends must be multiples of its step {self.step}")

    def __contains__(self, value: object) -> bool:
        """Whether the integer lies in the range and on its step."""
        return is_int(value) and self.low <= value <= self.high and value % self.step == 0


@dataclass(frozen=True, slots=True)
class FloatRange:
    """Floats from `low` to `high`, both included."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"a range's low end must be below its high end, got [ {self.low}, {self.high} ]")

    def __contains__(self, value: object) -> bool:
        """Whether the float lies in the range."""
        return isinstance(value, float) and self.low <= value <= self.high


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
class ValueList:
    """Alternatives, the preferred one first."""

    items: tuple[Value, ...]


@dataclass(frozen=True, slots=True)
class ValueArray:
    """An ordered sequence; arrays meet element by element."""

    items: tuple[Value, ...]


Range = IntRange | FloatRange | FractionRange
Value = bool | int | float | str | bytes | Fraction | Range | ValueList | ValueArray


def is_int(value: object) -> TypeGuard[int]:
    """Whether a value is an integer of caps (booleans are a type of their own)."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_fixed(value: Value) -> bool:
    """Whether a value is one value and not a choice."""
    if isinstance(value, IntRange | FloatRange | FractionRange | ValueList):
        return False
    return not isinstance(value, ValueArray) or all(is_fixed(item) for item in value.items)


def same_type_equal(left: Value, right: Value) -> bool:
    """Equality that keeps int, float, bool, Fraction and str apart."""
    return type(left) is type(right) and left == right


def intersect_values(left: Value, right: Value) -> Value | None:
    """What both values allow, in the order of `left`; None where nothing is left."""
    if isinstance(left, ValueList):
        return _intersect_list(left, right, flipped=False)
    if isinstance(right, ValueList):
        return _intersect_list(right, left, flipped=True)
    if isinstance(left, ValueArray) and isinstance(right, ValueArray):
        return _intersect_arrays(left, right)
    if isinstance(left, IntRange) and isinstance(right, IntRange):
        return _intersect_int_ranges(left, right)
    if isinstance(left, FloatRange) and isinstance(right, FloatRange):
        low, high = max(left.low, right.low), min(left.high, right.high)
        return FloatRange(low, high) if low < high else low if low == high else None
    if isinstance(left, FractionRange) and isinstance(right, FractionRange):
        bottom, top = max(left.low, right.low), min(left.high, right.high)
        return FractionRange(bottom, top) if bottom < top else bottom if bottom == top else None
    if isinstance(right, IntRange | FloatRange | FractionRange):
        return left if not isinstance(left, IntRange | FloatRange | FractionRange) and left in right else None
    if isinstance(left, IntRange | FloatRange | FractionRange):
        return right if right in left else None
    return left if same_type_equal(left, right) else None


def _intersect_list(choices: ValueList, other: Value, *, flipped: bool) -> Value | None:
    found: list[Value] = []
    for item in choices.items:
        common = intersect_values(other, item) if flipped else intersect_values(item, other)
        for value in common.items if isinstance(common, ValueList) else (common,):
            if value is not None and not any(same_type_equal(value, known) for known in found):
                found.append(value)
    if not found:
        return None
    return found[0] if len(found) == 1 else ValueList(tuple(found))


def _intersect_arrays(left: ValueArray, right: ValueArray) -> Value | None:
    if len(left.items) != len(right.items):
        return None
    items = [intersect_values(a, b) for a, b in zip(left.items, right.items, strict=True)]
    if any(item is None for item in items):
        return None
    return ValueArray(tuple(item for item in items if item is not None))


def _intersect_int_ranges(left: IntRange, right: IntRange) -> Value | None:
    step = math.lcm(left.step, right.step)
    low = -(-max(left.low, right.low) // step) * step
    high = min(left.high, right.high) // step * step
    if low > high:
        return None
    return low if low == high else IntRange(low, high, step)


def is_subset_value(inner: Value, outer: Value) -> bool:
    """Whether everything that `inner` allows is allowed by `outer`."""
    if isinstance(inner, ValueList):
        return all(is_subset_value(item, outer) for item in inner.items)
    if isinstance(outer, ValueList):
        return any(is_subset_value(inner, item) for item in outer.items)
    if isinstance(inner, ValueArray) and isinstance(outer, ValueArray):
        return len(inner.items) == len(outer.items) and all(map(is_subset_value, inner.items, outer.items))
    if isinstance(inner, IntRange) and isinstance(outer, IntRange):
        return outer.low <= inner.low and inner.high <= outer.high and inner.step % outer.step == 0
    if isinstance(inner, FloatRange) and isinstance(outer, FloatRange):
        return outer.low <= inner.low and inner.high <= outer.high
    if isinstance(inner, FractionRange) and isinstance(outer, FractionRange):
        return outer.low <= inner.low and inner.high <= outer.high
    if isinstance(inner, IntRange | FloatRange | FractionRange):
        return False
    if isinstance(outer, IntRange | FloatRange | FractionRange):
        return inner in outer
    return same_type_equal(inner, outer)


def fixate_value(value: Value, near: Value | None = None) -> Value:
    """One value out of a choice: the one nearest to `near`, else the first entry or the low end."""
    if isinstance(value, ValueList):
        if not value.items:
            return value
        if near is not None and is_fixed(near):
            for item in value.items:
                if is_subset_value(near, item):
                    return near
            closest = [fixate_value(item, near) for item in value.items]
            if all(is_int(item) for item in [*closest, near]):
                return min(closest, key=lambda item: abs(item - near))  # type: ignore[operator]
            return closest[0]
        return fixate_value(value.items[0])
    if isinstance(value, IntRange):
        if not is_int(near):
            return value.low
        clamped = min(max(near, value.low), value.high)
        return (clamped // value.step) * value.step
    if isinstance(value, FloatRange):
        return min(max(near, value.low), value.high) if isinstance(near, float) else value.low
    if isinstance(value, FractionRange):
        return min(max(near, value.low), value.high) if isinstance(near, Fraction) else value.low
    if isinstance(value, ValueArray):
        return ValueArray(tuple(fixate_value(item) for item in value.items))
    return value
