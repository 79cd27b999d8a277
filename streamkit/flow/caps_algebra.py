"""Equality, intersection and subset of the values of caps fields.

Source: GStreamer's documentation of its value functions, and what GStreamer 1.22 returns.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import Any

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps_values import (
    SCALARS,
    FlagSet,
    IntRange,
    NestedStructure,
    Range,
    Value,
    ValueArray,
    ValueList,
)

MEMBER_LIMIT = 1_000
PIECE_LIMIT = 256


def same_type_equal(left: Value, right: Value) -> bool:
    """Equality of values of the same type: 1, 1.0, True and Int64(1) differ."""
    if type(left) is not type(right):
        return False
    if isinstance(left, ValueList | ValueArray) and isinstance(right, ValueList | ValueArray):
        return len(left.items) == len(right.items) and all(map(same_type_equal, left.items, right.items))
    return left == right


def values_equal(left: Value, right: Value) -> bool:
    """Equality as in GStreamer: lists in any order; a list of one value equals that value."""
    kind = type(left)
    if kind is type(right) and kind in SCALARS:
        return left == right
    if isinstance(left, ValueList):
        return _list_equal(left, right)
    if isinstance(right, ValueList):
        return _list_equal(right, left)
    if isinstance(left, ValueArray) and isinstance(right, ValueArray):
        return len(left.items) == len(right.items) and all(map(values_equal, left.items, right.items))
    return same_type_equal(left, right)


def _list_equal(choices: ValueList, other: Value) -> bool:
    if not isinstance(other, ValueList):
        return bool(choices.items) and all(values_equal(item, other) for item in choices.items)
    if len(choices.items) != len(other.items):
        return False
    scalars, others = scalar_keys(choices), scalar_keys(other)
    if scalars is not None and others is not None:
        return Counter(scalars) == Counter(others)
    left = list(other.items)
    for item in choices.items:
        place = next((i for i, known in enumerate(left) if values_equal(item, known)), None)
        if place is None:
            return False
        del left[place]
    return True


def scalar_keys(choices: ValueList) -> list[tuple[type, Value]] | None:
    """Type and value of each member, in order; None unless all are scalars."""
    if all(type(item) in SCALARS for item in choices.items):
        return [(type(item), item) for item in choices.items]
    return None


def intersect_values(left: Value, right: Value) -> Value | None:
    """The intersection in the order of `left`, None if empty; raises `CapsTooLarge`."""
    kind = type(left)
    if kind is type(right) and kind in SCALARS:
        return left if left == right else None
    if isinstance(left, ValueList):
        return _intersect_list(left, right)
    if isinstance(right, ValueList):
        return _intersect_list(right, left)
    if isinstance(left, ValueArray) and isinstance(right, ValueArray):
        return _intersect_arrays(left, right)
    if isinstance(left, Range) and isinstance(right, Range):
        return _intersect_ranges(left, right)
    if isinstance(right, Range):
        return left if left in right else None
    if isinstance(left, Range):
        return right if right in left else None
    if isinstance(left, FlagSet) and isinstance(right, FlagSet):
        return join_flags(left, right)
    if isinstance(left, NestedStructure) and isinstance(right, NestedStructure):
        return left if left == right else left.intersect(right)
    return left if same_type_equal(left, right) else None


def join_flags(left: FlagSet, right: FlagSet) -> FlagSet | None:
    """The flags set by either; None if they conflict."""
    if type(left) is not type(right) or (left.flags ^ right.flags) & left.mask & right.mask:
        return None
    return type(left)(left.flags | right.flags, left.mask | right.mask)


def _intersect_list(choices: ValueList, other: Value) -> Value | None:
    if isinstance(other, ValueList):
        keys, others = scalar_keys(choices), scalar_keys(other)
        if keys is not None and others is not None:
            return as_choice(_paired(keys, others))
        if len(choices.items) > 1 and _list_equal(choices, other):
            return choices
    found: list[Value] = []
    for item in choices.items:
        common = intersect_values(item, other)
        if common is not None and type(common) in SCALARS and not isinstance(other, ValueList):
            # As in GStreamer, repeated values are kept, except at the beginning.
            if len(found) != 1 or not values_equal(found[0], common):
                found.append(common)
        elif common is not None:
            add_choices(found, common)
    return as_choice(found)


def _paired(keys: list[tuple[type, Value]], others: list[tuple[type, Value]]) -> list[Value]:
    """The values that are in both lists, each as often as in both, in the order of the first."""
    left = Counter(others)
    found: list[Value] = []
    for key in keys:
        if left[key]:
            left[key] -= 1
            found.append(key[1])
    return found


def add_choices(found: list[Value], value: Value) -> None:
    """Appends a value, or the members of a list, unless they are there; raises `CapsTooLarge`."""
    for item in value.items if isinstance(value, ValueList) else (value,):
        if not any(values_equal(item, known) for known in found):
            found.append(item)
    if len(found) > MEMBER_LIMIT:
        raise CapsTooLarge(f"a field of the caps has more than {MEMBER_LIMIT} alternatives")


def as_choice(items: list[Value]) -> Value | None:
    """A list of these alternatives; a single one by itself, None for none."""
    if not items:
        return None
    return items[0] if len(items) == 1 else ValueList(tuple(items))


def _intersect_arrays(left: ValueArray, right: ValueArray) -> Value | None:
    if len(left.items) != len(right.items):
        return None
    if values_equal(left, right):
        return left
    found: list[Value] = []
    for mine, theirs in zip(left.items, right.items, strict=True):
        common = intersect_values(mine, theirs)
        if common is None:
            return None
        found.append(common)
    return ValueArray(tuple(found))


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
    kind = type(inner)
    if kind is type(outer) and kind in SCALARS:
        return inner == outer
    if isinstance(inner, ValueList):
        keys = scalar_keys(inner)
        others = scalar_keys(outer) if keys is not None and isinstance(outer, ValueList) else None
        if keys is not None and others is not None:
            return set(keys) <= set(others)
        return all(is_subset_value(item, outer) for item in inner.items)
    if isinstance(outer, ValueList):
        return any(is_subset_value(inner, item) for item in outer.items) or _covered(inner, outer)
    if isinstance(inner, ValueArray) and isinstance(outer, ValueArray):
        return len(inner.items) == len(outer.items) and all(map(is_subset_value, inner.items, outer.items))
    if isinstance(inner, Range):
        return isinstance(outer, Range) and _range_within(inner, outer)
    if isinstance(outer, Range):
        return inner in outer
    if isinstance(inner, FlagSet) and isinstance(outer, FlagSet) and type(inner) is type(outer):
        return outer.mask & ~inner.mask == 0 and inner.flags & outer.mask == outer.flags
    if isinstance(inner, NestedStructure) and isinstance(outer, NestedStructure):
        return inner.is_subset(outer)
    return same_type_equal(inner, outer)


def _range_within(inner: Range[Any], outer: Range[Any]) -> bool:
    if type(inner) is not type(outer):
        return False
    if isinstance(inner, IntRange) and isinstance(outer, IntRange) and inner.step % outer.step:
        # A range of two values may still lie on a coarser step.
        return inner.high - inner.low == inner.step and inner.low in outer and inner.high in outer
    return bool(outer.low <= inner.low and inner.high <= outer.high)


def _covered(inner: Value, outer: ValueList) -> bool:
    """Whether several members of a list together contain a range: `[ 1, 3 ]` is within `{ 1, [ 2, 3 ] }`."""
    if not isinstance(inner, Range) or len(outer.items) < 2:
        return False
    keys = scalar_keys(outer)
    if keys is not None and type(inner) is IntRange:
        known = set(keys)
        inside = range(inner.low, inner.high + 1, inner.step)
        return len(inside) <= len(known) and all((int, value) in known for value in inside)
    from streamkit.flow.caps_simplify import subtract_values

    return subtract_values(inner, outer) is None
