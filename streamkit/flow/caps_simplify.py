"""Caps in other forms: without lists, or in as few structures as possible; difference and union of values.

Pipelines need none of it; `streamkit caps` and programs that know GStreamer's caps do.
Source: GStreamer's documentation of gst_caps_normalize, gst_caps_simplify and of its value functions, and
what GStreamer 1.22 returns.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import groupby

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps_algebra import (
    ANY_FEATURES,
    Structure,
    as_choice,
    extended,
    is_subset_value,
    join_flags,
    members,
    pieces_without,
    values_equal,
)
from streamkit.flow.caps_values import FlagSet, IntRange, Range, Value, ValueArray, ValueList

NORMAL_LIMIT = 10_000


def normalize(structures: Sequence[Structure]) -> tuple[Structure, ...]:
    """The same formats without lists; structures for further list entries are appended.

    Raises:
        CapsTooLarge: the result has more than 10 000 structures.
    """
    waiting, found = deque(structures), list[Structure]()
    while waiting:
        structure = waiting.popleft()
        while (listed := _first_list(structure)) is not None and listed[1].items:
            name, choices = listed
            waiting.extend(structure.with_field(name, item) for item in choices.items[1:])
            structure = structure.with_field(name, choices.items[0])
        if listed is None:
            found.append(structure)
        if len(found) + len(waiting) > NORMAL_LIMIT:
            raise CapsTooLarge(f"normalized the caps have more than {NORMAL_LIMIT} structures")
    return tuple(found)


def _first_list(structure: Structure) -> tuple[str, ValueList] | None:
    fields = structure.fields.items()
    return next(((name, value) for name, value in fields if isinstance(value, ValueList)), None)


def simplify(structures: Sequence[Structure]) -> tuple[Structure, ...]:
    """The same formats in fewer structures, sorted by name.

    Structures that differ in one field are merged; subsets of other structures are removed.
    """
    ordered = sorted(structures, key=lambda structure: (structure.name, -len(structure.fields)))
    kept = [one for index, one in enumerate(ordered) if not _is_redundant(index, ordered)]
    runs = groupby(kept, lambda structure: (structure.name, frozenset(structure.features)))
    found = list[Structure]()
    for _, alike in runs:
        run = list(alike)
        for index in reversed(range(len(run))):  # the last is merged first
            _merge_into_others(run, index)
        found += run
    return tuple(found)


def _is_redundant(index: int, structures: Sequence[Structure]) -> bool:
    """Whether a structure is a subset of another with any features; the last of equal ones is kept."""
    one = structures[index]
    return any(
        one.is_subset(other) and (place > index or not other.is_subset(one))
        for place, other in enumerate(structures)
        if other.features == ANY_FEATURES and place != index
    )


def _merge_into_others(run: list[Structure], index: int) -> None:
    """Removes from a structure what others have, and the structure if nothing is left or one can take it."""
    for place in reversed(range(len(run))):
        if place == index:
            continue
        excess = _excess(run[index], run[place])
        if excess is not None and len(excess) == 1:
            run[index] = run[index].with_field(*excess.popitem())
        elif excess == {}:
            del run[index]
            return
        elif (joined := join_structures(run[place], run[index])) is not None:
            run[place] = joined
            del run[index]
            return


def _excess(structure: Structure, other: Structure) -> dict[str, Value] | None:
    """What a structure has beyond another, by field; None if they are disjoint, as far as values can say.

    If that is one field, the difference of the two is one structure: the first with this value of the field.
    """
    found: dict[str, Value] = {}
    for name, value in other.fields.items():
        if name not in structure.fields:
            return None
        mine = structure.fields[name]
        rest = subtract_values(mine, value)
        if rest is None:
            continue
        if values_equal(rest, mine):
            return None
        found[name] = rest
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
    """The difference of two values; None if empty. What cannot be written is left unchanged."""
    if isinstance(minuend, ValueList):
        rests = [subtract_values(item, subtrahend) for item in minuend.items]
        return as_choice([item for rest in rests if rest is not None for item in members(rest)])
    if isinstance(minuend, Range):
        return as_choice(pieces_without(minuend, members(subtrahend)))
    return None if is_subset_value(minuend, subtrahend) else minuend


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
        united = join_structures(left, right)
        if united is not None:
            return united
    if _member_type(left) is not _member_type(right):
        return None
    return extended(members(left), right)


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
