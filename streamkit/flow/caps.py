"""Caps: what kinds of frames a pad can carry, and the algebra on them.

Source: GStreamer's documentation of GstCaps; results as GStreamer 1.22 gives them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps_forms import normalize, simplify
from streamkit.flow.caps_reader import STRUCTURE_LIMIT, WORDS, CapsReader
from streamkit.flow.caps_structure import NO_FIELDS, Structure
from streamkit.flow.caps_values import NestedValue, Value

__all__ = ["ANY", "EMPTY", "Caps", "Structure", "read_value"]
CACHED_TEXTS, CACHED_LENGTH = 512, 2_000
WORK_LIMIT = 1_000_000


class Caps(NestedValue):
    """An immutable set of frame formats, in order of preference.

    Built from text, `Caps("video/x-raw, format=GRAY8, width=[ 1, 4096 ]")`, or from structures.
    `ANY` is everything, `EMPTY` (or `NONE`) nothing.

    Operators: `a & b` what both allow in the order of `a`; `a | b` what either allows; `a <= b` whether
    everything that `a` allows is allowed by one structure of `b`; `a == b` whether each is within the other.

    Raises:
        CapsSyntax: the text is no caps.
        CapsTooLarge: an operation gives more structures, or alternatives of a field, than are kept.
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
            read = _read_known if len(source) <= CACHED_LENGTH else _read
            self.is_any, self.structures = read(source)
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
        return _met((mine, theirs) for mine in self.structures for theirs in other.structures)

    def intersect(self, other: Caps) -> Caps:
        """What both allow, in the zig-zag order of gst_caps_intersect: what either side prefers comes first.

        Pairs of structures are tried by the sum of their places, among equals the earlier of `other` first.
        """
        if self.is_any or other.is_any or self is other:
            return self & other
        return _met(_zigzag(self.structures, other.structures))

    def can_intersect(self, other: Caps) -> bool:
        """Whether there is anything that both allow."""
        if self.is_any or other.is_any:
            return bool(self) and bool(other)
        return any(
            mine.name == theirs.name and mine.intersect(theirs) is not None
            for mine in self.structures
            for theirs in other.structures
        )

    def __or__(self, other: Caps) -> Caps:
        if self.is_any or other.is_any:
            return ANY
        found = list(self.structures)
        for theirs in other.structures:
            _merge(found, theirs)
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

    def strictly_equal(self, other: Caps) -> bool:
        """Whether both have equal structures in the same order."""
        return (
            self.is_any == other.is_any
            and len(self.structures) == len(other.structures)
            and all(map(Structure.equal, self.structures, other.structures))
        )

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
        wanted = near.structures[0].fields if near is not None and near.structures else NO_FIELDS
        return Caps((self.structures[0].fixate(wanted),))

    def truncate(self) -> Caps:
        """The first structure only."""
        return self if len(self.structures) < 2 else Caps(self.structures[:1])

    def normalize(self) -> Caps:
        """The same formats with a structure of its own for each entry of a list."""
        return self if self.is_any else Caps(normalize(self.structures))

    def simplify(self) -> Caps:
        """The same formats in as few structures as may be, sorted by name."""
        return self if self.is_any else Caps(simplify(self.structures))

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

    @property
    def nested_fixed(self) -> bool:
        """Caps as a value are one value, whatever they allow, as in GStreamer."""
        return True

    def nested_equal(self, other: NestedValue) -> bool:
        """Whether the other are equal caps."""
        return isinstance(other, Caps) and self == other

    def nested_meet(self, other: NestedValue) -> Caps | None:
        """Caps as a value meet equal caps only, as in GStreamer."""
        return self if self.nested_equal(other) else None

    def nested_join(self, other: NestedValue) -> None:
        """Caps as a value join with no others."""

    def nested_within(self, other: NestedValue) -> bool:
        """Caps as a value are within equal caps only, as in GStreamer."""
        return self.nested_equal(other)

    def nested_fixate(self) -> Caps:
        """Caps as a value stay as they are, as in GStreamer."""
        return self


def _merge(found: list[Structure], structure: Structure) -> None:
    """Appends a structure that none of those found allows already."""
    if any(structure.is_subset(known) for known in found):
        return
    found.append(structure)
    if len(found) > STRUCTURE_LIMIT:
        raise CapsTooLarge(f"the caps would have more than {STRUCTURE_LIMIT} structures")


def _met(pairs: Iterable[tuple[Structure, Structure]]) -> Caps:
    found: list[Structure] = []
    work = 0
    for mine, theirs in pairs:
        if mine.name == theirs.name:
            common = mine.intersect(theirs)
            if common is not None:
                _merge(found, common)
                work += len(found)
                if work > WORK_LIMIT:
                    raise CapsTooLarge(f"the intersection takes more than {WORK_LIMIT} comparisons")
    return Caps(found)


def _zigzag(
    left: tuple[Structure, ...], right: tuple[Structure, ...]
) -> Iterator[tuple[Structure, Structure]]:
    for total in range(len(left) + len(right) - 1):
        for place in range(max(0, total - len(left) + 1), min(total + 1, len(right))):
            yield left[total - place], right[place]


def read_value(text: str) -> Value:
    """One value as it stands in a field of caps.

    Raises:
        CapsSyntax: the text is no value.
    """
    return CapsReader(text, _nested_caps).only_value()


def _read(text: str) -> tuple[bool, tuple[Structure, ...]]:
    word = text.strip()
    if word in WORDS:
        return word == "ANY", ()
    return False, CapsReader(text, _nested_caps).structures()


def _nested_caps(structures: tuple[Structure, ...] | None) -> Caps:
    return ANY if structures is None else Caps(structures)


_read_known = lru_cache(CACHED_TEXTS)(_read)
ANY = Caps("ANY")
EMPTY = Caps("EMPTY")
