"""Caps and their values as JSON objects, as `streamkit caps` prints them."""

from __future__ import annotations

from datetime import date
from fractions import Fraction
from typing import Any

from streamkit.flow.caps import Caps, Structure
from streamkit.flow.caps_serialize import type_name
from streamkit.flow.caps_values import (
    FlagSet,
    FloatRange,
    FractionRange,
    IntRange,
    NullText,
    Value,
    ValueArray,
    ValueList,
)


def describe_caps(caps: Caps) -> dict[str, Any]:
    """`{"caps", "any", "empty", "size", "fixed", "structures"}`."""
    return {
        "caps": str(caps),
        "any": caps.is_any,
        "empty": caps.is_empty,
        "size": len(caps.structures),
        "fixed": caps.is_fixed,
        "structures": [describe_structure(structure) for structure in caps.structures],
    }


def describe_structure(structure: Structure) -> dict[str, Any]:
    """`{"name", "features", "fields"}`, a field as `{"type", "value"}`."""
    return {
        "name": structure.name,
        "features": list(structure.features),
        "fields": {name: describe_value(value) for name, value in structure.fields.items()},
    }


def describe_value(value: Value) -> dict[str, Any]:
    """`{"type", "value"}`.

    `type` is GStreamer's word, of a range, list or array that of its members. A range is
    `{"range": [low, high]}` or `[low, high, step]`, a list `{"list": [...]}`, an array `{"array": [...]}`,
    both of values with their types.
    """
    return {"type": type_name(value), "value": plain_value(value)}


def plain_value(value: Value) -> Any:
    """The value itself: a number, text or truth value, or an object for what JSON has no value for."""
    if isinstance(value, ValueList):
        return {"list": [describe_value(item) for item in value.items]}
    if isinstance(value, ValueArray):
        return {"array": [describe_value(item) for item in value.items]}
    if isinstance(value, IntRange):
        ends = [value.low, value.high] + ([value.step] if value.step != 1 else [])
        return {"range": [int(end) for end in ends]}
    if isinstance(value, FloatRange | FractionRange):
        return {"range": [plain_value(value.low), plain_value(value.high)]}
    if isinstance(value, FlagSet):
        return {"flags": value.flags, "mask": value.mask}
    if isinstance(value, Caps):
        return describe_caps(value)
    if isinstance(value, Structure):
        return describe_structure(value)
    return _plain_scalar(value)


def _plain_scalar(value: Value) -> Any:
    """A value that holds no other values."""
    if isinstance(value, Fraction):
        return f"{value.numerator}/{value.denominator}"
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, date):
        return value.isoformat()
    return None if isinstance(value, NullText) else value
