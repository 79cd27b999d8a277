"""Caps: the frame formats that a pad can carry, and their algebra.

Source: GStreamer's documentation of GstCaps; results as in GStreamer 1.22.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps_algebra import NO_FIELDS, Structure, members
from streamkit.flow.caps_reader import STRUCTURE_LIMIT, CapsReader
from streamkit.flow.caps_simplify import normalize, simplify
from streamkit.flow.caps_values import Nested, Value

__all__ = ["ANY", "EMPTY", "Caps", "Structure", "read_value"]
CACHED_TEXTS, CACHED_LENGTH = 512, 2_000
WORK_LIMIT = 1_000_000


class Caps(Nested):
    """An immutable set of frame formats, in order of preference.

    Built from text, `Caps("video/x-raw, format=GRAY8, width=[ 1, 4096 ]")`, or from structures.
    `ANY` is everything, `EMPTY` (or `NONE`) nothing.

    Operators: `a & b` is the intersection in the order of `a`, `a | b` the union; `a <= b` is true if each
    structure of `a` is a subset of a structure of `b`, and `a == b` if both `a <= b` and `b <= a`.

    Raises:
        CapsSyntax: the text cannot be parsed.
        CapsTooLarge: a result has too many structures, or alternatives of a field.
    """

    __slots__ = ("is_any", "structures")
    type_name = "GstCaps"

    def __init__(self, source: str | Caps | Iterable[Structure] = ()) -> None:
        self.is_any = False
        self.structures: tuple[Structure, ...]
        if isinstance(source, Caps):
            self.is_any, self.structures = source.is_any, source.structures
        elif isinstance(source, str):
            read = _read_known if len(source) <= CACHED_LENGTH else _read
            self.is_any, self.structures = read(source)
        else:
            self.structures = tuple(source)

    @property
    def is_empty(self) -> bool:
        """Whether no format is allowed."""
        return not self.is_any and not self.structures

    @property
    def is_fixed(self) -> bool:
        """Whether exactly one format is allowed."""
        return len(self.structures) == 1 and self.structures[0].is_fixed

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
        """The value of an integer field; raises `KeyError` if it is not a single integer."""
        value = self[field_name]
        if not isinstance(value, int) or isinstance(value, bool):
            raise KeyError(f"field {field_name!r} of caps {self} must be one integer")
        return value

    def __and__(self, other: Caps) -> Caps:
        if self.is_any:
            return other
        if other.is_any or self is other:
            return self
        return _intersections(itertools.product(self.structures, other.structures))

    def intersect(self, other: Caps) -> Caps:
        """The intersection in the zig-zag order of gst_caps_intersect, which weighs both sides' preferences.

        Pairs of structures are ordered by the sum of their indices, then by the index in `other`.
        """
        if self.is_any or other.is_any or self is other:
            return self & other
        pairs = itertools.product(enumerate(self.structures), enumerate(other.structures))
        ordered = sorted(pairs, key=lambda pair: (pair[0][0] + pair[1][0], pair[1][0]))
        return _intersections((mine, theirs) for (_, mine), (_, theirs) in ordered)

    def can_intersect(self, other: Caps) -> bool:
        """Whether the intersection is not empty."""
        if self.is_any or other.is_any:
            return bool(self) and bool(other)
        pairs = itertools.product(self.structures, other.structures)
        return any(mine.intersect(theirs) is not None for mine, theirs in pairs)

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
        return self.is_any == other.is_any and self.structures == other.structures

    def __hash__(self) -> int:
        return hash((self.is_any, frozenset(structure.name for structure in self.structures)))

    def __bool__(self) -> bool:
        return not self.is_empty

    def __str__(self) -> str:
        return "; ".join(map(str, self.structures)) or ("ANY" if self.is_any else "EMPTY")

    def __repr__(self) -> str:
        return f"Caps({str(self)!r})"

    def fixate(self, near: Caps | None = None) -> Caps:
        """Fixes the first structure: each field to the value nearest to `near`, else its first or lowest."""
        if not self.structures:
            return self
        wanted = near.structures[0].fields if near is not None and near.structures else NO_FIELDS
        return Caps((self.structures[0].fixate(wanted),))

    def truncate(self) -> Caps:
        """The first structure only."""
        return self if len(self.structures) < 2 else Caps(self.structures[:1])

    def normalize(self) -> Caps:
        """The same formats with one structure for each entry of a list."""
        return self if self.is_any else Caps(normalize(self.structures))

    def simplify(self) -> Caps:
        """The same formats in as few structures as possible, sorted by name."""
        return self if self.is_any else Caps(simplify(self.structures))

    def with_fields(self, **fields: Value) -> Caps:
        """The same caps with these fields set in every structure."""
        return self.map_fields(lambda known: {**known, **fields})

    def map_fields(self, change: Callable[[Mapping[str, Value]], Mapping[str, Value]]) -> Caps:
        """The same caps, each structure with the fields that a function makes of its own."""
        return Caps([Structure(s.name, change(s.fields), s.features) for s in self.structures])

    def without_fields(self, *names: str) -> Caps:
        """The same caps with any value for these fields."""
        if self.is_any:
            return self
        return EMPTY | self.map_fields(
            lambda fields: {name: value for name, value in fields.items() if name not in names}
        )

    def conflict(self, other: Caps) -> str:
        """The name of the field in which two caps conflict, for errors."""
        pairs = itertools.product(self.structures, other.structures)
        names = (mine.conflict(theirs) for mine, theirs in pairs)
        return next((name for name in names if name not in (None, "media type")), None) or "media type"

    def disagreement(self, accepted: Caps, src: str, sink: str) -> str:
        """Text for an error: the field in which offered and accepted caps conflict, and both, with names."""
        field = self.conflict(accepted)
        text = f"disagree on {field}: {src} offers {self}; {sink} takes {accepted}"
        offered, taken = (_words(caps, field) for caps in (self, accepted))
        # Words are GStreamer's, where RGB and rgb are different formats.
        for word, others in [(word, offered) for word in taken] + [(word, taken) for word in offered]:
            if word != word.upper() and word.upper() in others:
                return f"{text}; write {field}={word.upper()}"
        return text


def _words(caps: Caps, field: str) -> list[str]:
    """The texts that a field may have."""
    values = [structure.fields[field] for structure in caps.structures if field in structure.fields]
    return [item for value in values for item in members(value) if isinstance(item, str)]


def _merge(found: list[Structure], structure: Structure) -> None:
    """Appends a structure unless it is a subset of one found already."""
    if any(structure.is_subset(known) for known in found):
        return
    found.append(structure)
    if len(found) > STRUCTURE_LIMIT:
        raise CapsTooLarge(f"the caps would have more than {STRUCTURE_LIMIT} structures")


def _intersections(pairs: Iterable[tuple[Structure, Structure]]) -> Caps:
    found: list[Structure] = []
    work = 0
    for mine, theirs in pairs:
        common = mine.intersect(theirs)
        if common is not None:
            _merge(found, common)
            work += len(found)
            if work > WORK_LIMIT:
                raise CapsTooLarge(f"the intersection takes more than {WORK_LIMIT} comparisons")
    return Caps(found)


def read_value(text: str) -> Value:
    """Parses the value of a field; raises `CapsSyntax`."""
    return CapsReader(text).only_value()


def _read(text: str) -> tuple[bool, tuple[Structure, ...]]:
    return CapsReader(text).caps()


_read_known = lru_cache(CACHED_TEXTS)(_read)
ANY = Caps("ANY")
EMPTY = Caps("EMPTY")
