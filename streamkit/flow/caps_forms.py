"""Other forms of the same caps: one structure for each list entry, or as few structures as may be.

Source: GStreamer's documentation of gst_caps_normalize and gst_caps_simplify, and what 1.22 answers.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps_algebra import values_equal
from streamkit.flow.caps_difference import subtract_values
from streamkit.flow.caps_structure import Structure
from streamkit.flow.caps_values import ValueList

NORMAL_LIMIT = 10_000


def normalize(structures: Sequence[Structure]) -> tuple[Structure, ...]:
    """The same formats with no list in any field; what a list adds stands at the end.

    Raises:
        CapsTooLarge: that would be more than 10 000 structures.
    """
    waiting, found = deque(structures), list[Structure]()
    while waiting:
        structure = waiting.popleft()
        name = _first_list(structure)
        while name is not None:
            choices = structure.fields[name]
            items = choices.items if isinstance(choices, ValueList) else ()
            if not items:
                break
            waiting.extend(structure.with_field(name, item) for item in items[1:])
            structure = structure.with_field(name, items[0])
            name = _first_list(structure)
        if name is None:
            found.append(structure)
        if len(found) + len(waiting) > NORMAL_LIMIT:
            raise CapsTooLarge(f"normalized the caps have more than {NORMAL_LIMIT} structures")
    return tuple(found)


def _first_list(structure: Structure) -> str | None:
    return next((name for name, value in structure.fields.items() if isinstance(value, ValueList)), None)


def simplify(structures: Sequence[Structure]) -> tuple[Structure, ...]:
    """The same formats in fewer structures: sorted by name, those merged that differ in one field only.

    A structure that another allows is left out; parts that others allow are taken away.
    """
    if len(structures) < 2:
        return tuple(structures)
    kept = sorted(structures, key=lambda structure: (structure.name, -len(structure.fields)))
    last = len(kept) - 1
    for index in range(last, -1, -1):
        if not _same_family(kept[index], kept[last]):
            last = index
        for other in range(last, -1, -1):
            if other == index:
                continue
            if not _same_family(kept[index], kept[other]):
                break
            if not kept[index].same_features(kept[other]):
                if not kept[index].is_subset(kept[other]):
                    continue
                del kept[index]
                last -= 1
                break
            rest = _without(kept[index], kept[other])
            if rest is not None and len(rest) == 1:
                kept[index] = rest[0]
                continue
            if rest is None or len(rest) > 1:
                joined = kept[other].join(kept[index])
                if joined is None:
                    continue
                kept[other] = joined
            del kept[index]
            last -= 1
            break
    return tuple(kept)


def _same_family(one: Structure, other: Structure) -> bool:
    return one.same_kind(other)


def _without(structure: Structure, other: Structure) -> list[Structure] | None:
    """What `structure` allows and `other` does not, as structures; None where they do not overlap."""
    found: list[Structure] = []
    for name, value in other.fields.items():
        if name not in structure.fields:
            return None
        mine = structure.fields[name]
        rest = subtract_values(mine, value)
        if rest is None:
            continue
        if values_equal(rest, mine):
            return None
        found.append(structure.with_field(name, rest))
    return found
