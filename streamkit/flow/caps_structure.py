"""Structures of caps, and fixation of their values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from typing_extensions import override

from streamkit.flow.caps_algebra import intersect_values, is_subset_value, values_equal
from streamkit.flow.caps_serialize import write_structure
from streamkit.flow.caps_values import (
    FULL_MASK,
    FlagSet,
    IntRange,
    NestedStructure,
    Range,
    Value,
    ValueArray,
    ValueList,
    is_fixed,
)

NO_FIELDS: Mapping[str, Value] = MappingProxyType({})
ANY_FEATURES = ("ANY",)


@dataclass(frozen=True, slots=True, eq=False)
class Structure(NestedStructure):
    """One alternative of caps: a media type with features and fields.

    `features` are unique and in the order written; `()` is system memory, `("ANY",)` any features.
    """

    name: str
    fields: Mapping[str, Value] = field(default_factory=lambda: NO_FIELDS)
    features: tuple[str, ...] = ()

    def __str__(self) -> str:
        return write_structure(self.name, self.features, self.fields)

    @property
    def is_fixed(self) -> bool:
        """Whether every field has one value, and the features are known."""
        return self.features != ANY_FEATURES and all(map(is_fixed, self.fields.values()))

    def same_features(self, other: Structure) -> bool:
        """Whether both have the same features, in any order."""
        mine, theirs = self.features, other.features
        return mine == theirs or (len(mine) == len(theirs) > 1 and set(mine) == set(theirs))

    def same_kind(self, other: Structure) -> bool:
        """Whether names are equal and features compatible (`ANY` matches all features)."""
        if self.name != other.name:
            return False
        return self.same_features(other) or ANY_FEATURES in (self.features, other.features)

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
        features = other.features if self.features == ANY_FEATURES else self.features
        return Structure(self.name, fields, features)

    def conflict(self, other: Structure) -> str | None:
        """The first conflict: "media type", "features", a field name, or None."""
        if self.name != other.name:
            return "media type"
        if not self.same_kind(other):
            return "features"
        for name, value in self.fields.items():
            if name in other.fields and intersect_values(value, other.fields[name]) is None:
                return name
        return None

    @override
    def is_subset(self, other: Structure) -> bool:
        if self.name != other.name:
            return False
        if other.features != ANY_FEATURES and not self.same_features(other):
            return False
        return all(
            name in self.fields and is_subset_value(self.fields[name], value)
            for name, value in other.fields.items()
        )

    def __eq__(self, other: object) -> bool:
        """Whether name, features and fields are the same, in any order."""
        return (
            isinstance(other, Structure)
            and self.name == other.name
            and self.same_features(other)
            and self.fields.keys() == other.fields.keys()
            and all(values_equal(value, other.fields[name]) for name, value in self.fields.items())
        )

    __hash__ = None  # type: ignore[assignment]

    def with_field(self, name: str, value: Value) -> Structure:
        """A copy with one field set."""
        return Structure(self.name, {**self.fields, name: value}, self.features)

    def fixate(self, near: Mapping[str, Value] = NO_FIELDS) -> Structure:
        """Fixes each field to the value nearest to `near`, else to its first or lowest value."""
        fields = {name: fixate_value(value, near.get(name)) for name, value in self.fields.items()}
        return Structure(self.name, fields, () if self.features == ANY_FEATURES else self.features)


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
    return value.fixate() if isinstance(value, NestedStructure) else value


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
