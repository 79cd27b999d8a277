"""Picking one value out of what a field allows."""

from __future__ import annotations

from fractions import Fraction

from streamkit.flow.caps_algebra import is_subset_value
from streamkit.flow.caps_values import (
    FULL_MASK,
    FlagSet,
    FloatRange,
    FractionRange,
    IntRange,
    NestedValue,
    Value,
    ValueArray,
    ValueList,
    is_fixed,
)


def fixate_value(value: Value, near: Value | None = None) -> Value:
    """One value out of a choice: the one nearest to `near`, else the first entry or the low end."""
    if isinstance(value, ValueList):
        return _pick(value, near) if value.items else value
    if isinstance(value, IntRange):
        if type(near) is not value.number:
            return value.low
        return value.number(min(max(near, value.low), value.high) // value.step * value.step)
    if isinstance(value, FloatRange):
        return min(max(near, value.low), value.high) if isinstance(near, float) else value.low
    if isinstance(value, FractionRange):
        return min(max(near, value.low), value.high) if isinstance(near, Fraction) else value.low
    if isinstance(value, ValueArray):
        return ValueArray(tuple(fixate_value(item) for item in value.items))
    if isinstance(value, FlagSet):
        return type(value)(value.flags, FULL_MASK)
    return value.nested_fixate() if isinstance(value, NestedValue) else value


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
