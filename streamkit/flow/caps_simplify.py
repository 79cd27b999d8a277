"""Caps in other forms: without lists, or in as few structures as possible; difference and union of values.

A difference that cannot be written (a hole in a range of floats or fractions, ranges of different steps), or
that has very many parts, leaves the value unchanged.
Source: GStreamer's documentation of gst_caps_normalize, gst_caps_simplify and of its value functions, and
what GStreamer 1.22 returns.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps_algebra import (
    PIECE_LIMIT,
    add_choices,
    as_choice,
    is_subset_value,
    join_flags,
    narrowed,
    scalar_keys,
    values_equal,
)
from streamkit.flow.caps_structure import Structure
from streamkit.flow.caps_values import SCALARS, FlagSet, IntRange, Range, Value, ValueArray, ValueList

NORMAL_LIMIT = 10_000


def normalize(structures: Sequence[Structure]) -> tuple[Structure, ...]:
    """The same formats without lists; structures for further list entries are appended.

    Raises:
        CapsTooLarge: the result has more than 10 000 structures.
    """
    waiting, found = deque(structures), list[Structure]()
    while waiting:
        structure = waiting.popleft()
        name = _first_list(structure)
        while name is not None:
            choices = structure.fields[name]
            items = choices.items if isinstance(choices, ValueList) else ()
            if not items:
                break
            waiting.extend(structure.with_field(name, item) for item in items[1:])
            structure = structure.with_field(name, items[0])
            name = _first_list(structure)
        if name is None:
            found.append(structure)
        if len(found) + len(waiting) > NORMAL_LIMIT:
            raise CapsTooLarge(f"normalized the caps have more than {NORMAL_LIMIT} structures")
    return tuple(found)


def _first_list(structure: Structure) -> str | None:
    return next((name for name, value in structure.fields.items() if isinstance(value, ValueList)), None)


def simplify(structures: Sequence[Structure]) -> tuple[Structure, ...]:
    """The same formats in fewer structures, sorted by name.

    Structures that differ in one field are merged; subsets of other structures are removed.
    """
    if len(structures) < 2:
        return tuple(structures)
    kept = sorted(structures, key=lambda structure: (structure.name, -len(structure.fields)))
    last = len(kept) - 1
    for index in range(last, -1, -1):
        if not kept[index].same_kind(kept[last]):
            last = index
        for other in range(last, -1, -1):
            if other == index:
                continue
            if not kept[index].same_kind(kept[other]):
                break
            if not kept[index].same_features(kept[other]):
                if not kept[index].is_subset(kept[other]):
                    continue
                del kept[index]
                last -= 1
                break
            rest = _without(kept[index], kept[other])
            if rest is not None and len(rest) == 1:
                kept[index] = rest[0]
                continue
            if rest is None or len(rest) > 1:
                joined = join_structures(kept[other], kept[index])
                if joined is None:
                    continue
                kept[other] = joined
            del kept[index]
            last -= 1
            break
    return tuple(kept)


def _without(structure: Structure, other: Structure) -> list[Structure] | None:
    """The difference as structures; None if the two do not overlap."""
    found: list[Structure] = []
    for name, value in other.fields.items():
        if name not in structure.fields:
            return None
        mine = structure.fields[name]
        rest = subtract_values(mine, value)
        if rest is None:
            continue
        if values_equal(rest, mine):
            return None
        found.append(structure.with_field(name, rest))
    return found


def join_structures(one: Structure, other: Structure) -> Structure | None:
    """The union of two structures that differ in one field only; otherwise None."""
    if one.name != other.name or not one.same_features(other) or one.fields.keys() != other.fields.keys():
        return None
    unlike = [name for name, value in one.fields.items() if not values_equal(value, other.fields[name])]
    if len(unlike) != 1:
        return None
    both = unite_values(one.fields[unlike[0]], other.fields[unlike[0]])
    return None if both is None else one.with_field(unlike[0], both)


def subtract_values(minuend: Value, subtrahend: Value) -> Value | None:
    """The difference of two values; None if empty."""
    if isinstance(minuend, ValueList):
        keys = scalar_keys(minuend)
        others = scalar_keys(subtrahend) if keys is not None and isinstance(subtrahend, ValueList) else None
        if keys is not None and others is not None:
            gone = set(others)
            return as_choice([key[1] for key in keys if key not in gone])
        found: list[Value] = []
        for item in minuend.items:
            rest = subtract_values(item, subtrahend)
            found.extend(rest.items if isinstance(rest, ValueList) else () if rest is None else (rest,))
        return as_choice(found)
    if isinstance(subtrahend, ValueList):
        if isinstance(minuend, Range) and len(subtrahend.items) > PIECE_LIMIT:
            return minuend
        left: Value | None = minuend
        for item in subtrahend.items:
            if left is None:
                return None
            left = subtract_values(left, item)
        return left
    if is_subset_value(minuend, subtrahend):
        return None
    if isinstance(minuend, IntRange):
        return _subtract_from_integers(minuend, subtrahend)
    if isinstance(minuend, Range) and type(subtrahend) is type(minuend):
        parts = (
            (minuend.low, min(minuend.high, subtrahend.low)),
            (max(minuend.low, subtrahend.high), minuend.high),
        )
        return as_choice([replace(minuend, low=low, high=high) for low, high in parts if low < high])
    return minuend


def _subtract_from_integers(minuend: IntRange, subtrahend: Value) -> Value | None:
    step = minuend.step
    if type(subtrahend) is minuend.number and subtrahend in minuend:
        first, last = int(subtrahend), int(subtrahend)
    elif (
        isinstance(subtrahend, IntRange) and type(subtrahend) is type(minuend) and step % subtrahend.step == 0
    ):
        first = -(-max(minuend.low, subtrahend.low) // step) * step
        last = min(minuend.high, subtrahend.high) // step * step
        if first > last:
            return minuend
    else:
        return minuend
    pieces = narrowed(minuend, minuend.low, first - step), narrowed(minuend, last + step, minuend.high)
    return as_choice([piece for piece in pieces if piece is not None])


def unite_values(left: Value, right: Value) -> Value | None:
    """The union of two values: one range, flag set or structure if possible, otherwise a list.

    Returns:
        The union; None for different types, and for int ranges and flag sets that do not join.

    Raises:
        CapsTooLarge: the list has too many members.
    """
    if is_subset_value(right, left):
        return left
    if isinstance(left, FlagSet) and isinstance(right, FlagSet):
        return join_flags(left, right)
    if type(left) is IntRange and type(right) in (int, IntRange):
        return _extend(left, right)
    if type(right) is IntRange and type(left) is int:
        return _extend(right, left)
    if isinstance(left, Structure) and isinstance(right, Structure):
        joined = join_structures(left, right)
        if joined is not None:
            return joined
    if _member_type(left) is not _member_type(right):
        return None
    items = list(left.items if isinstance(left, ValueList) else (left,))
    known = {(type(item), item) for item in items if type(item) in SCALARS}
    for item in right.items if isinstance(right, ValueList) else (right,):
        if type(item) in SCALARS:
            if (type(item), item) not in known:
                known.add((type(item), item))
                items.append(item)
        else:
            add_choices(items, item)
    return as_choice(items)


def _member_type(value: Value) -> type:
    """Type of a value, of the first member of a list or array, or of the ends of a range."""
    while isinstance(value, ValueList | ValueArray) and value.items:
        value = value.items[0]
    return value.number if isinstance(value, Range) else type(value)


def _extend(span: IntRange, other: Value) -> Value | None:
    """The union of a range and an overlapping or adjacent value or range of the same step, else None."""
    if is_subset_value(other, span):
        return span
    if is_subset_value(span, other):
        return other
    step = span.step
    if isinstance(other, IntRange):
        low, high = other.low, other.high
        if other.step != step:
            return None
    elif isinstance(other, int) and other % step == 0:
        low = high = other
    else:
        return None
    if max(low, span.low) - min(high, span.high) > step:
        return None
    return IntRange(min(low, span.low), max(high, span.high), step)
