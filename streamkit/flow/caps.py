"""Caps: what kinds of frames a pad can carry, and the algebra on them.

Source: GStreamer's documentation of GstCaps; results as GStreamer 1.22 gives them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from streamkit.flow.caps_text import CapsReader, write_value
from streamkit.flow.caps_values import (
    Value,
    fixate_value,
    intersect_values,
    is_fixed,
    is_subset_value,
    same_type_equal,
)

NO_FIELDS: Mapping[str, Value] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Structure:
    """One alternative of caps: a media type with features and fields."""

    name: str
    fields: Mapping[str, Value] = field(default_factory=lambda: NO_FIELDS)
    features: tuple[str, ...] = ()

    def __str__(self) -> str:
        features = f"({', '.join(self.features)})" if self.features else ""
        fields = "".join(f", {name}={write_value(value)}" for name, value in self.fields.items())
        return f"{self.name}{features}{fields}"

    @property
    def is_fixed(self) -> bool:
        """Whether every field has one value."""
        return all(is_fixed(value) for value in self.fields.values())

    def same_kind(self, other: Structure) -> bool:
        """Whether names agree and features are compatible (`ANY` matches all features)."""
        if self.name != other.name:
            return False
        return self.features == other.features or ("ANY",) in (self.features, other.features)

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
        return Structure(self.name, fields, other.features if self.features == ("ANY",) else self.features)

    def conflict(self, other: Structure) -> str | None:
        """The name of the first thing that keeps two structures apart, or None."""
        if self.name != other.name:
            return "media type"
        if not self.same_kind(other):
            return "features"
        for name in self.fields.keys() & other.fields.keys():
            if intersect_values(self.fields[name], other.fields[name]) is None:
                return name
        return None

    def is_subset(self, other: Structure) -> bool:
        """Whether everything this structure allows is allowed by the other."""
        if self.name != other.name or other.features not in (self.features, ("ANY",)):
            return False
        return all(
            name in self.fields and is_subset_value(self.fields[name], value)
            for name, value in other.fields.items()
        )

    def equal(self, other: Structure) -> bool:
        """Same name, features and fields, whatever their order."""
        return (
            self.name == other.name
            and self.features == other.features
            and self.fields.keys() == other.fields.keys()
            and all(same_type_equal(value, other.fields[name]) for name, value in self.fields.items())
        )


class Caps:
    """An immutable set of frame formats, in order of preference.

    Built from text, `Caps("video/x-raw, format=GRAY8, width=[ 1, 4096 ]")`, or from structures.
    `ANY` is everything, `EMPTY` (or `NONE`) nothing.

    Raises:
        CapsSyntax: the text is no caps.
    """

    __slots__ = ("_fixed", "_text", "is_any", "structures")

    def __init__(self, source: str | Caps | tuple[Structure, ...] | list[Structure] = ()) -> None:
        self.is_any = False
        self._text: str | None = None
        self._fixed: bool | None = None
        self.structures: tuple[Structure, ...] = ()
        if isinstance(source, Caps):
            self.is_any, self.structures = source.is_any, source.structures
        elif isinstance(source, str):
            word = source.strip()
            if word == "ANY":
                self.is_any = True
            elif word not in ("EMPTY", "NONE"):
                texts = CapsReader(source).structures()
                self.structures = tuple(Structure(name, fields, marks) for name, marks, fields in texts)
        else:
            self.structures = tuple(source)

    @property
    def is_empty(self) -> bool:
        """Whether nothing is allowed."""
        return not self.is_any and not self.structures

    @property
    def is_fixed(self) -> bool:
        """Whether exactly one format is allowed."""
        if self._fixed is None:
            self._fixed = len(self.structures) == 1 and self.structures[0].is_fixed
        return self._fixed

    @property
    def name(self) -> str:
        """The media type of the first structure, "ANY" or "EMPTY"."""
        if self.structures:
            return self.structures[0].name
        return "ANY" if self.is_any else "EMPTY"

    def __getitem__(self, field_name: str) -> Value:
        if not self.structures or field_name not in self.structures[0].fields:
            raise KeyError(f"caps {self} have no field {field_name!r}")
        return self.structures[0].fields[field_name]

    def get(self, field_name: str, default: Value | None = None) -> Value | None:
        """The value of a field of the first structure, or `default`."""
        return self.structures[0].fields.get(field_name, default) if self.structures else default

    def integer(self, field_name: str) -> int:
        """The value of an integer field.

        Raises:
            KeyError: there is no such field, or it is not one integer.
        """
        value = self[field_name]
        if not isinstance(value, int) or isinstance(value, bool):
            raise KeyError(f"field {field_name!r} of caps {self} must be one integer")
        return value

    def __and__(self, other: Caps) -> Caps:
        if self.is_any:
            return other
        if other.is_any or self is other:
            return self
        found: list[Structure] = []
        for mine in self.structures:
            for theirs in other.structures:
                common = mine.intersect(theirs)
                if common is not None and not any(common.is_subset(known) for known in found):
                    found.append(common)
        return Caps(found)

    def __or__(self, other: Caps) -> Caps:
        if self.is_any or other.is_any:
            return ANY
        found = list(self.structures)
        for theirs in other.structures:
            if not any(theirs.is_subset(known) for known in found):
                found.append(theirs)
        return Caps(found)

    def __le__(self, other: Caps) -> bool:
        if other.is_any or self.is_empty:
            return True
        if self.is_any:
            return False
        return all(any(mine.is_subset(theirs) for theirs in other.structures) for mine in self.structures)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Caps):
            return NotImplemented
        return self is other or (self <= other <= self)

    def __hash__(self) -> int:
        return hash((self.is_any, frozenset(structure.name for structure in self.structures)))

    def __bool__(self) -> bool:
        return not self.is_empty

    def __str__(self) -> str:
        if self._text is None:
            words = [str(structure) for structure in self.structures]
            self._text = "; ".join(words) or ("ANY" if self.is_any else "EMPTY")
        return self._text

    def __repr__(self) -> str:
        return f"Caps({str(self)!r})"

    def fixate(self, near: Caps | None = None) -> Caps:
        """One format: in the first structure each field nearest to `near`, or its first or lowest value."""
        if not self.structures:
            return self
        first = self.structures[0]
        wanted = near.structures[0].fields if near is not None and near.structures else NO_FIELDS
        fields = {name: fixate_value(value, wanted.get(name)) for name, value in first.fields.items()}
        return Caps((Structure(first.name, fields, first.features),))

    def with_fields(self, **fields: Value) -> Caps:
        """The same caps with these fields set in every structure."""
        return Caps([Structure(s.name, {**s.fields, **fields}, s.features) for s in self.structures])

    def without_fields(self, *names: str) -> Caps:
        """The same caps without these fields, that is with any value for them."""
        if self.is_any:
            return self
        found = Caps()
        for structure in self.structures:
            kept = {name: value for name, value in structure.fields.items() if name not in names}
            found = found | Caps((Structure(structure.name, kept, structure.features),))
        return found

    def conflict(self, other: Caps) -> str:
        """The field that keeps two caps apart, for error texts."""
        best = "media type"
        for mine in self.structures:
            for theirs in other.structures:
                field_name = mine.conflict(theirs)
                if field_name not in (None, "media type"):
                    return str(field_name)
        return best


ANY = Caps("ANY")
EMPTY = Caps("EMPTY")
