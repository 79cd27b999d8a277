"""Structures of caps, and the values of their fields as sets: equality, intersection, subset, fixation.

A list is a set of alternatives; any other value is the only alternative of itself.
Source: GStreamer's documentation of its value functions, and what GStreamer 1.22 returns.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps_values import (
    FULL_MASK,
    SCALARS,
    FlagSet,
    IntRange,
    Nested,
    Range,
    Value,
    ValueArray,
    ValueList,
    write_structure,
)

NO_FIELDS: Mapping[str, Value] = MappingProxyType({})
ANY_FEATURES = ("ANY",)
MEMBER_LIMIT = 1_000
PIECE_LIMIT = 256


def value_key(value: Value) -> Hashable:
    """A key that equal values share. 1, 1.0, True and Int64(1) differ; a list may be in any order."""
    if isinstance(value, ValueList):
        counts = Counter(map(value_key, value.items))
        return next(iter(counts)) if len(counts) == 1 else (ValueList, frozenset(counts.items()))
    if isinstance(value, ValueArray):
        return ValueArray, tuple(map(value_key, value.items))
    if isinstance(value, Structure):
        fields = frozenset((name, value_key(item)) for name, item in value.fields.items())
        return value.name, frozenset(value.features), fields
    return type(value), value


def values_equal(left: Value, right: Value) -> bool:
    """Equality as in GStreamer: lists in any order; a list of one value equals that value."""
    return value_key(left) == value_key(right)


def members(value: Value) -> tuple[Value, ...]:
    """The alternatives of a value."""
    return value.items if isinstance(value, ValueList) else (value,)


def as_choice(items: Sequence[Value]) -> Value | None:
    """A list of these alternatives; a single one by itself, None for none."""
    if not items:
        return None
    return items[0] if len(items) == 1 else ValueList(tuple(items))


def extended(items: Iterable[Value], value: Value) -> Value | None:
    """A choice of these alternatives and of those of a value that are not among them.

    Raises:
        CapsTooLarge: it has too many alternatives.
    """
    found = list(items)
    known = set(map(value_key, found))
    for item in members(value):
        if (key := value_key(item)) not in known:
            known.add(key)
            found.append(item)
    if sum(type(item) not in SCALARS for item in found) > MEMBER_LIMIT:
        raise CapsTooLarge(f"a field of the caps has more than {MEMBER_LIMIT} alternatives")
    return as_choice(found)


def intersect_values(left: Value, right: Value) -> Value | None:
    """The intersection in the order of `left`, None if empty; raises `CapsTooLarge`."""
    if type(left) in SCALARS and type(right) in SCALARS:
        return left if type(left) is type(right) and left == right else None
    if isinstance(left, ValueList):
        return _intersect_list(left, right)
    if isinstance(right, ValueList):
        return _intersect_list(right, left)
    if isinstance(left, Range) and isinstance(right, Range):
        return _intersect_ranges(left, right)
    if isinstance(right, Range):
        return left if left in right else None
    if isinstance(left, Range):
        return right if right in left else None
    if values_equal(left, right):
        return left
    if isinstance(left, ValueArray) and isinstance(right, ValueArray) and len(left.items) == len(right.items):
        common = [intersect_values(*pair) for pair in zip(left.items, right.items, strict=True)]
        found = tuple(item for item in common if item is not None)
        return ValueArray(found) if len(found) == len(common) else None
    if isinstance(left, FlagSet) and isinstance(right, FlagSet):
        return join_flags(left, right)
    if isinstance(left, Structure) and isinstance(right, Structure):
        return left.intersect(right)
    return None


def join_flags(left: FlagSet, right: FlagSet) -> FlagSet | None:
    """The flags set by either; None if they conflict."""
    if type(left) is not type(right) or (left.flags ^ right.flags) & left.mask & right.mask:
        return None
    return type(left)(left.flags | right.flags, left.mask | right.mask)


def _intersect_list(choices: ValueList, other: Value) -> Value | None:
    if isinstance(other, ValueList) and (
        not (choices.others or other.others) or values_equal(choices, other)
    ):
        return as_choice(_paired(choices, other))
    found = [common for item in choices.items if (common := intersect_values(item, other)) is not None]
    if isinstance(other, ValueList):
        return extended((), ValueList(tuple(member for common in found for member in members(common))))
    while len(found) > 1 and values_equal(found[0], found[1]):
        del found[1]  # as in GStreamer, repeated values are kept, except at the beginning
    return as_choice(found)


def _paired(choices: ValueList, other: ValueList) -> list[Value]:
    """The values that are in both lists, each as often as in both, in the order of the first."""
    left = Counter(map(value_key, other.items))
    found: list[Value] = []
    for item in choices.items:
        if left[key := value_key(item)]:
            left[key] -= 1
            found.append(item)
    return found


def _intersect_ranges(left: Range[Any], right: Range[Any]) -> Value | None:
    if type(left) is not type(right):
        return None
    low, high = max(left.low, right.low), min(left.high, right.high)
    if isinstance(left, IntRange) and isinstance(right, IntRange):
        step = math.lcm(left.step, right.step)
        return narrowed(left, -(-low // step) * step, high // step * step, step=step)
    return narrowed(left, low, high)


def narrowed(span: Range[Any], low: Any, high: Any, **changes: int) -> Value | None:
    """The range with other ends; the number itself if they are equal, None if nothing is left."""
    if low < high:
        return replace(span, low=span.number(low), high=span.number(high), **changes)
    return span.number(low) if low == high else None


def is_subset_value(inner: Value, outer: Value) -> bool:
    """Whether `inner` is a subset of `outer`."""
    if type(inner) in SCALARS and type(outer) in SCALARS:
        return type(inner) is type(outer) and inner == outer
    if isinstance(inner, ValueList):
        return all(is_subset_value(item, outer) for item in inner.items)
    if isinstance(outer, ValueList):
        if type(inner) in SCALARS and (type(inner), inner) in outer.scalars:
            return True
        if any(is_subset_value(inner, item) for item in outer.others):
            return True
        # `[ 1, 3 ]` is within `{ 1, [ 2, 3 ] }`.
        return isinstance(inner, Range) and len(outer.items) > 1 and not pieces_without(inner, outer.items)
    if isinstance(inner, ValueArray) and isinstance(outer, ValueArray):
        return len(inner.items) == len(outer.items) and all(map(is_subset_value, inner.items, outer.items))
    if isinstance(inner, Range) and isinstance(outer, Range):
        return _range_within(inner, outer)
    if isinstance(outer, Range):
        return inner in outer
    if isinstance(inner, FlagSet) and type(inner) is type(outer):
        return outer.mask & ~inner.mask == 0 and inner.flags & outer.mask == outer.flags
    if isinstance(inner, Structure) and isinstance(outer, Structure):
        return inner.is_subset(outer)
    return values_equal(inner, outer)


def _range_within(inner: Range[Any], outer: Range[Any]) -> bool:
    if type(inner) is not type(outer):
        return False
    if isinstance(inner, IntRange) and isinstance(outer, IntRange) and inner.step % outer.step:
        # A range of two values may still lie on a coarser step.
        return inner.high - inner.low == inner.step and inner.low in outer and inner.high in outer
    return bool(outer.low <= inner.low and inner.high <= outer.high)


def pieces_without(span: Value, removed: Sequence[Value]) -> list[Value]:
    """What is left of a range: ranges and numbers.

    A difference that cannot be written (a hole in a range of floats or fractions, ranges of different steps),
    or that may have very many parts, leaves the range unchanged.
    """
    pieces = [span]
    if len(removed) > PIECE_LIMIT:
        return pieces
    for item in removed:
        if isinstance(item, ValueList):
            pieces = [rest for piece in pieces for rest in pieces_without(piece, item.items)]
        else:
            pieces = [rest for piece in pieces for rest in _split(piece, item)]
    return pieces


def _split(span: Value, removed: Value) -> list[Value]:
    if is_subset_value(span, removed):
        return []
    if not isinstance(span, Range):
        return [span]
    if isinstance(span, IntRange) and isinstance(removed, int) and removed in span:
        first = last = int(removed)
    elif type(removed) is not type(span):
        return [span]
    elif isinstance(span, IntRange) and isinstance(removed, IntRange):
        if span.step % removed.step:
            return [span]
        first = -(-max(span.low, removed.low) // span.step) * span.step
        last = min(span.high, removed.high) // span.step * span.step
        if first > last:
            return [span]
    else:
        ends = (span.low, min(span.high, removed.low)), (max(span.low, removed.high), span.high)
        return [replace(span, low=low, high=high) for low, high in ends if low < high]
    rest = narrowed(span, span.low, first - span.step), narrowed(span, last + span.step, span.high)
    return [piece for piece in rest if piece is not None]


def is_fixed(value: Value) -> bool:
    """Whether a value is one value and not a choice."""
    if isinstance(value, Range | ValueList):
        return False
    if isinstance(value, ValueArray):
        return all(map(is_fixed, value.items))
    if isinstance(value, Structure):
        return all(map(is_fixed, value.fields.values()))
    return value.mask == FULL_MASK if isinstance(value, FlagSet) else True


def fixate_value(value: Value, near: Value | None = None) -> Value:
    """Fixes a choice to the value nearest to `near`, else to the first entry or the low end."""
    if isinstance(value, ValueList):
        return _pick(value, near) if value.items else value
    if isinstance(value, Range):
        if type(near) is not value.number:
            return value.low  # type: ignore[no-any-return]
        nearest = min(max(near, value.low), value.high)
        return value.number(nearest // value.step * value.step) if isinstance(value, IntRange) else nearest
    if isinstance(value, ValueArray):
        return ValueArray(tuple(fixate_value(item) for item in value.items))
    if isinstance(value, FlagSet):
        return type(value)(value.flags, FULL_MASK)
    return value.fixate() if isinstance(value, Structure) else value


def _pick(choices: ValueList, near: Value | None) -> Value:
    if near is None or not is_fixed(near):
        return fixate_value(choices.items[0])
    if any(is_subset_value(near, item) for item in choices.items):
        return near
    closest = [fixate_value(item, near) for item in choices.items]
    numbers = [item for item in closest if type(item) is int]
    if type(near) is int and len(numbers) == len(closest):
        return min(numbers, key=lambda number: abs(number - near))
    return closest[0]


@dataclass(frozen=True, slots=True, eq=False)
class Structure(Nested):
    """One alternative of caps: a media type with features and fields.

    `features` are unique and in the order written; `()` is system memory, `("ANY",)` any features.
    """

    name: str
    fields: Mapping[str, Value] = field(default_factory=lambda: NO_FIELDS)
    features: tuple[str, ...] = ()

    type_name: ClassVar[str] = "structure"

    def __str__(self) -> str:
        return write_structure(self.name, self.features, self.fields)

    def __eq__(self, other: object) -> bool:
        """Whether name, features and fields are the same, in any order."""
        return isinstance(other, Structure) and value_key(self) == value_key(other)

    def __hash__(self) -> int:
        return hash(value_key(self))

    @property
    def is_fixed(self) -> bool:
        """Whether every field has one value, and the features are known."""
        return self.features != ANY_FEATURES and is_fixed(self)

    def same_kind(self, other: Structure) -> bool:
        """Whether names are equal and features compatible (`ANY` matches all features)."""
        if self.name != other.name:
            return False
        return self.same_features(other) or ANY_FEATURES in (self.features, other.features)

    def same_features(self, other: Structure) -> bool:
        """Whether both have the same features, in any order."""
        return self.features == other.features or set(self.features) == set(other.features)

    def intersect(self, other: Structure) -> Structure | None:
        """The intersection, or None; a missing field means any value."""
        if not self.same_kind(other):
            return None
        fields = dict(self.fields)
        for name, value in other.fields.items():
            common = intersect_values(fields[name], value) if name in fields else value
            if common is None:
                return None
            fields[name] = common
        return Structure(
            self.name, fields, other.features if self.features == ANY_FEATURES else self.features
        )

    def conflict(self, other: Structure) -> str | None:
        """The first conflict: "media type", "features", a field name, or None."""
        if self.name != other.name:
            return "media type"
        if not self.same_kind(other):
            return "features"
        shared = (name for name in self.fields if name in other.fields)
        return next((n for n in shared if intersect_values(self.fields[n], other.fields[n]) is None), None)

    def is_subset(self, other: Structure) -> bool:
        """Whether everything the structure allows is allowed by the other."""
        if self.name != other.name or not (other.features == ANY_FEATURES or self.same_features(other)):
            return False
        return all(
            name in self.fields and is_subset_value(self.fields[name], value)
            for name, value in other.fields.items()
        )

    def with_field(self, name: str, value: Value) -> Structure:
        """A copy with one field set."""
        return Structure(self.name, {**self.fields, name: value}, self.features)

    def fixate(self, near: Mapping[str, Value] = NO_FIELDS) -> Structure:
        """Fixes each field to the value nearest to `near`, else to its first or lowest value."""
        fields = {name: fixate_value(value, near.get(name)) for name, value in self.fields.items()}
        return Structure(self.name, fields, () if self.features == ANY_FEATURES else self.features)
