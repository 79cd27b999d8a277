"""One alternative of caps: a media type with features and fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from streamkit.flow.caps_algebra import intersect_values, is_subset_value, values_equal
from streamkit.flow.caps_difference import unite_values
from streamkit.flow.caps_fixate import fixate_value
from streamkit.flow.caps_serialize import write_structure
from streamkit.flow.caps_values import NestedValue, Value, is_fixed

NO_FIELDS: Mapping[str, Value] = MappingProxyType({})
ANY_FEATURES = ("ANY",)


@dataclass(frozen=True, slots=True)
class Structure(NestedValue):
    """One alternative of caps: a media type with features and fields.

    `features` are in the order written, without repeats; `()` is memory of the system, `("ANY",)` any
    features.
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
        """Whether names agree and features are compatible (`ANY` matches all features)."""
        if self.name != other.name:
            return False
        return self.same_features(other) or ANY_FEATURES in (self.features, other.features)

    def intersect(self, other: Structure) -> Structure | None:
        """What both structures allow; a missing field means any value."""
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
        """The name of the first thing that keeps two structures apart, or None."""
        if self.name != other.name:
            return "media type"
        if not self.same_kind(other):
            return "features"
        for name, value in self.fields.items():
            if name in other.fields and intersect_values(value, other.fields[name]) is None:
                return name
        return None

    def is_subset(self, other: Structure) -> bool:
        """Whether everything this structure allows is allowed by the other."""
        if self.name != other.name:
            return False
        if other.features != ANY_FEATURES and not self.same_features(other):
            return False
        return all(
            name in self.fields and is_subset_value(self.fields[name], value)
            for name, value in other.fields.items()
        )

    def equal(self, other: Structure) -> bool:
        """Same name, features and fields, whatever their order."""
        return (
            self.name == other.name
            and self.same_features(other)
            and self.fields.keys() == other.fields.keys()
            and all(values_equal(value, other.fields[name]) for name, value in self.fields.items())
        )

    def join(self, other: Structure) -> Structure | None:
        """What either allows, where they have the same fields and all but one are equal; otherwise None."""
        if self.name != other.name or not self.same_features(other):
            return None
        if self.fields.keys() != other.fields.keys():
            return None
        unlike = [name for name, value in self.fields.items() if not values_equal(value, other.fields[name])]
        if len(unlike) != 1:
            return None
        both = unite_values(self.fields[unlike[0]], other.fields[unlike[0]])
        return None if both is None else self.with_field(unlike[0], both)

    def with_field(self, name: str, value: Value) -> Structure:
        """The same structure with one field set."""
        return Structure(self.name, {**self.fields, name: value}, self.features)

    def fixate(self, near: Mapping[str, Value] = NO_FIELDS) -> Structure:
        """One format: each field nearest to `near`, or its first or lowest value; no features for `ANY`."""
        fields = {name: fixate_value(value, near.get(name)) for name, value in self.fields.items()}
        return Structure(self.name, fields, () if self.features == ANY_FEATURES else self.features)

    @property
    def nested_fixed(self) -> bool:
        """Whether every field has one value."""
        return all(map(is_fixed, self.fields.values()))

    def nested_equal(self, other: NestedValue) -> bool:
        """Whether the other is an equal structure."""
        return isinstance(other, Structure) and self.equal(other)

    def nested_meet(self, other: NestedValue) -> Structure | None:
        """What both allow, as fields of caps."""
        return self.intersect(other) if isinstance(other, Structure) else None

    def nested_join(self, other: NestedValue) -> Structure | None:
        """Both in one, where one field only tells them apart."""
        return self.join(other) if isinstance(other, Structure) else None

    def nested_within(self, other: NestedValue) -> bool:
        """Whether it is a subset of the other, as fields of caps."""
        return isinstance(other, Structure) and self.is_subset(other)

    def nested_fixate(self) -> Structure:
        """The same structure with every field fixed."""
        return self.fixate()
