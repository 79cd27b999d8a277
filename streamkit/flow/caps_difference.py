"""What is left of a value when another is taken away, and what two values make together.

Both serve `simplify`. Where a difference cannot be written (a hole in a range of floats or fractions,
ranges of unlike steps) the value stays as it is.
Source: GStreamer's documentation of its value functions, and what GStreamer 1.22 answers.
"""

from __future__ import annotations

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps_algebra import (
    MEMBER_LIMIT,
    add_choices,
    as_choice,
    is_subset_value,
    join_flags,
    values_equal,
)
from streamkit.flow.caps_serialize import type_name
from streamkit.flow.caps_values import (
    FlagSet,
    FloatRange,
    FractionRange,
    IntRange,
    Value,
    ValueArray,
    ValueList,
)


def subtract_values(minuend: Value, subtrahend: Value) -> Value | None:
    """What `minuend` allows and `subtrahend` does not; None where nothing is left."""
    if isinstance(minuend, ValueList):
        found: list[Value] = []
        for item in minuend.items:
            rest = subtract_values(item, subtrahend)
            if rest is not None:
                add_choices(found, rest)
        return as_choice(found)
    if isinstance(subtrahend, ValueList):
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


def may_unite(left: Value, right: Value) -> bool:
    """Whether two values are of one type, so that a list can hold both; arrays go with arrays only."""
    one, other = (
        value.items[0] if isinstance(value, ValueList) and value.items else value for value in (left, right)
    )
    return type_name(one) == type_name(other) and isinstance(one, ValueArray) == isinstance(other, ValueArray)


def unite_values(left: Value, right: Value) -> Value:
    """What either value allows: one range or flag set where they join, a list otherwise.

    Raises:
        CapsTooLarge: the list has too many members.
    """
    joined = _join(left, right)
    if joined is not None:
        return joined
    items = [
        *(left.items if isinstance(left, ValueList) else (left,)),
        *(right.items if isinstance(right, ValueList) else (right,)),
    ]
    if len(items) > MEMBER_LIMIT:
        raise CapsTooLarge(f"a field of the caps has more than {MEMBER_LIMIT} alternatives")
    found: list[Value] = []
    for item in items:
        if not any(values_equal(item, known) for known in found):
            found.append(item)
    return as_choice(found) or ValueList(())


def _join(left: Value, right: Value) -> Value | None:
    if isinstance(left, FlagSet) and isinstance(right, FlagSet):
        return join_flags(left, right)
    if isinstance(left, IntRange) and isinstance(right, IntRange):
        return _join_ranges(left, right)
    if isinstance(left, IntRange) and type(right) is left.number:
        return _extend(left, int(right))
    if isinstance(right, IntRange) and type(left) is right.number:
        return _extend(right, int(left))
    return None


def _join_ranges(left: IntRange, right: IntRange) -> IntRange | None:
    if type(left) is not type(right):
        return None
    if is_subset_value(left, right):
        return right
    if is_subset_value(right, left):
        return left
    apart = max(left.low, right.low) - min(left.high, right.high)
    if left.step != right.step or apart > left.step:
        return None
    return type(left)(min(left.low, right.low), max(left.high, right.high), left.step)


def _extend(span: IntRange, value: int) -> IntRange | None:
    if span.number(value) in span:
        return span
    number = span.number
    if value == span.low - span.step:
        return type(span)(number(value), span.high, span.step)
    if value == span.high + span.step:
        return type(span)(span.low, number(value), span.step)
    return None
