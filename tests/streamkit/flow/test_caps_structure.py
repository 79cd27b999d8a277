"""Structures: features and fields."""

import pytest

from streamkit.flow.caps import Caps
from streamkit.flow.caps_algebra import Structure
from streamkit.flow.caps_simplify import join_structures
from streamkit.flow.caps_values import IntRange, ValueList


def read(text: str) -> Structure:
    """The only structure of a text."""
    (structure,) = Caps(text).structures
    return structure


@pytest.mark.parametrize(
    ("one", "other", "common"),
    [
        ("a/b, f=1, g=2", "a/b, h=3, f=[ 0, 5 ]", "a/b, f=(int)1, g=(int)2, h=(int)3"),
        ("a/b(memory:A, meta:B)", "a/b(meta:B, memory:A)", "a/b(memory:A, meta:B)"),
        ("a/b(ANY), f=1", "a/b(memory:A)", "a/b(memory:A), f=(int)1"),
        ("a/b(memory:A)", "a/b", None),
        ("a/b(meta:X)", "a/b(memory:SystemMemory, meta:X)", None),
        ("a/b", "a/c", None),
        ("a/b, f=[s, x=1]", "a/b, f=[s, y={ 1, 2 }]", "a/b, f=(structure)[s, x=(int)1, y=(int){ 1, 2 };]"),
        ("a/b, f=[s]", "a/b, f=[t]", None),
        ("a/b, f=(GstCaps)[s]", "a/b, f=(GstCaps)[s; t]", None),
        ("a/b, f=(GstCaps)[s; t]", "a/b, f=(GstCaps)[t; s]", "a/b, f=(GstCaps)[s; t]"),
    ],
)
def test_intersection(one: str, other: str, common: str | None) -> None:
    """Fields in the order of the first; features are a set; structures as values meet, caps only if equal."""
    found = read(one).intersect(read(other))
    assert (None if found is None else str(found)) == common


def test_fixation_includes_nested_structures() -> None:
    """The feature ANY becomes system memory."""
    structure = read("a/b(ANY), f=[s, x={ 1, 2 }], g=(GstCaps)[t, y={ 1, 2 }], h=[ 3, 9 ]")
    assert not structure.is_fixed
    fixed = structure.fixate()
    assert str(fixed) == "a/b, f=(structure)[s, x=(int)1;], g=(GstCaps)[t, y=(int){ 1, 2 }], h=(int)3"
    assert fixed.is_fixed


def test_two_structures_join_where_one_field_differs() -> None:
    """Any other difference, a missing field or a type, keeps them apart."""
    one = Structure("a/b", {"f": 1, "g": 2})
    assert join_structures(one, Structure("a/b", {"f": 1, "g": 3})) == Structure(
        "a/b", {"f": 1, "g": ValueList((2, 3))}
    )
    assert join_structures(one, Structure("a/b", {"f": 2, "g": 3})) is None
    assert join_structures(one, Structure("a/b", {"f": 1})) is None
    assert join_structures(one, Structure("a/b", {"f": 1, "g": "x"})) is None
    assert join_structures(one, Structure("a/b", {"f": 1, "g": 3}, ("memory:A",))) is None


def test_the_first_conflicting_field_is_named() -> None:
    """In the order of the structure's own fields."""
    one = Structure("a/b", {"width": 1, "height": IntRange(1, 2), "format": "GRAY8"})
    other = Structure("a/b", {"format": "BGR", "height": 9})
    assert one.conflict(other) == "height"
    assert one.conflict(Structure("a/b", {"width": 1})) is None
