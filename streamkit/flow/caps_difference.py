"""What is left of a value when another is taken away, and what two values make together.

Both serve `simplify`. Where a difference cannot be written (a hole in a range of floats or fractions,
ranges of unlike steps), or has very many parts, the value stays as it is.
Source: GStreamer's documentation of its value functions, and what GStreamer 1.22 answers.
"""

from __future__ import annotations

from streamkit.flow.caps_algebra import (
    PIECE_LIMIT,
    SCALARS,
    add_choices,
    as_choice,
    is_subset_value,
    join_flags,
    scalar_keys,
)
from streamkit.flow.caps_values import (
    RANGES,
    FlagSet,
    FloatRange,
    FractionRange,
    IntRange,
    NestedValue,
    Value,
    ValueArray,
    ValueList,
)


def subtract_values(minuend: Value, subtrahend: Value) -> Value | None:
    """What `minuend` allows and `subtrahend` does not; None where nothing is left."""
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
        if isinstance(minuend, RANGES) and len(subtrahend.items) > PIECE_LIMIT:
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
    if isinstance(minuend, FloatRange) and isinstance(subtrahend, FloatRange):
        return as_choice(
            [
                FloatRange(low, high)
                for low, high in (
                    (minuend.low, min(minuend.high, subtrahend.low)),
                    (max(minuend.low, subtrahend.high), minuend.high),
                )
                if low < high
            ]
        )
    if isinstance(minuend, FractionRange) and isinstance(subtrahend, FractionRange):
        return as_choice(
            [
                FractionRange(start, end)
                for start, end in (
                    (minuend.low, min(minuend.high, subtrahend.low)),
                    (max(minuend.low, subtrahend.high), minuend.high),
                )
                if start < end
            ]
        )
    return minuend


def _subtract_from_integers(minuend: IntRange, subtrahend: Value) -> Value | None:
    step, number = minuend.step, minuend.number
    if type(subtrahend) is number and subtrahend in minuend:
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
    pieces: list[Value] = []
    for low, high in ((minuend.low, first - step), (last + step, minuend.high)):
        if low < high:
            pieces.append(type(minuend)(number(low), number(high), step))
        elif low == high:
            pieces.append(number(low))
    return as_choice(pieces)


def unite_values(left: Value, right: Value) -> Value | None:
    """What either value allows: one range, flag set or structure where they join, a list otherwise.

    Returns:
        The union; None where the types differ, or for ranges of int and flag sets that do not join, of which
        GStreamer makes no lists.

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
    if isinstance(left, NestedValue) and isinstance(right, NestedValue):
        joined = left.nested_join(right)
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
    """The type of a value, or of the first member of a list or array; of a range that of its ends."""
    while isinstance(value, ValueList | ValueArray) and value.items:
        value = value.items[0]
    if isinstance(value, IntRange):
        return value.number
    return type(value.low) if isinstance(value, FloatRange | FractionRange) else type(value)


def _extend(span: IntRange, other: Value) -> Value | None:
    """The range with a value or a range of the same step that it holds, overlaps or borders on."""
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
