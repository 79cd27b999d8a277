"""Equality, intersection and subset of values of caps fields."""

from fractions import Fraction

import pytest

from streamkit.flow.caps_algebra import (
    intersect_values,
    is_subset_value,
    values_equal,
)
from streamkit.flow.caps_values import (
    Bitmask,
    FlagSet,
    FloatRange,
    FractionRange,
    Int64,
    Int64Range,
    IntRange,
    MultiviewFlags,
    UInt,
    Value,
    ValueArray,
    ValueList,
)


def test_values_of_different_types_are_not_equal() -> None:
    """1, 1.0, True and 1/1 are equal in Python only."""
    values: list[Value] = [1, 1.0, True, Fraction(1), "1"]
    for i, left in enumerate(values):
        assert [values_equal(left, right) for right in values] == [i == j for j in range(len(values))]


@pytest.mark.parametrize(
    ("left", "right", "common"),
    [
        (IntRange(0, 10), IntRange(5, 20), IntRange(5, 10)),
        (IntRange(0, 10), IntRange(10, 20), 10),
        (IntRange(0, 10), IntRange(11, 20), None),
        (IntRange(0, 24, 4), IntRange(6, 24, 6), IntRange(12, 24, 12)),
        (IntRange(0, 10, 5), IntRange(1, 9), 5),
        (FloatRange(0.0, 1.0), FloatRange(1.0, 2.0), 1.0),
        (FloatRange(0.0, 1.0), FloatRange(1.5, 2.0), None),
        (FractionRange(Fraction(0), Fraction(30)), FractionRange(Fraction(25), Fraction(60)),
         FractionRange(Fraction(25), Fraction(30))),
        (IntRange(0, 10), 7, 7),
        (7, IntRange(0, 10), 7),
        (IntRange(0, 10), 7.0, None),
        (30, Fraction(30), None),
        (ValueList(("NV12", "I420")), ValueList(("I420", "NV12")), ValueList(("NV12", "I420"))),
        (ValueList(("NV12", "I420")), "I420", "I420"),
        (ValueList((1, 2, 3)), IntRange(2, 9), ValueList((2, 3))),
        (ValueList((1, 1, 1)), ValueList((1, 2)), 1),
        (ValueList(()), 1, None),
        (ValueArray((ValueList((1, 2)), 3)), ValueArray((1, 3)), ValueArray((1, 3))),
        (ValueArray((1, 2)), ValueArray((1, 2, 3)), None),
        (ValueArray((1, 2)), 1, None),
    ],
)  # fmt: skip
def test_intersection(left: Value, right: Value, common: Value | None) -> None:
    """In the order of the left value; a single value is not a list."""
    assert intersect_values(left, right) == common


@pytest.mark.parametrize(
    ("inner", "outer", "contained"),
    [
        (5, IntRange(0, 10), True),
        (IntRange(2, 4), IntRange(0, 10), True),
        (IntRange(0, 10), IntRange(2, 4), False),
        (IntRange(0, 8, 4), IntRange(0, 8, 2), True),
        (IntRange(0, 8, 2), IntRange(0, 8, 4), False),
        (IntRange(0, 10), 5, False),
        (ValueList((1, 2)), ValueList((3, 2, 1)), True),
        (ValueList((1, 2)), 1, False),
        (1, ValueList((1, 2)), True),
        (ValueList((1, 1)), 1, True),
        (FloatRange(0.2, 0.3), FloatRange(0.0, 1.0), True),
        (FractionRange(Fraction(1), Fraction(2)), FractionRange(Fraction(0), Fraction(3)), True),
        (ValueArray((1, 2)), ValueArray((IntRange(0, 5), 2)), True),
        (ValueArray((1, 2)), ValueArray((1,)), False),
    ],
)
def test_subset(inner: Value, outer: Value, contained: bool) -> None:
    """Everything that the inner value allows is allowed by the outer one."""
    assert is_subset_value(inner, outer) is contained


@pytest.mark.parametrize(
    ("left", "right", "common"),
    [
        (Int64Range(Int64(0), Int64(9)), Int64(3), Int64(3)),
        (Int64Range(Int64(0), Int64(9)), 3, None),
        (Int64Range(Int64(0), Int64(9)), IntRange(0, 9), None),
        (UInt(1), 1, None),
        (Bitmask(3), Bitmask(3), Bitmask(3)),
        (Bitmask(3), Bitmask(1), None),
        (FlagSet(0xFFD81D, 0xFFFFF0), FlagSet(0x0FD81F, 0x0FFFF0), FlagSet(0xFFD81D, 0xFFFFF0)),
        (FlagSet(0xFF001D, 0x0FFFF0), FlagSet(0x0FD81F, 0x0FFFF0), None),
        (FlagSet(1, 3), MultiviewFlags(1, 3), None),
        (ValueList((1, 2, 3, 1)), IntRange(1, 5), ValueList((1, 2, 3, 1))),
        (ValueList((1, 1)), IntRange(1, 5), 1),
        (ValueList((1, 2, 1)), ValueList((2, 1, 1)), ValueList((1, 2, 1))),
        (ValueList((1, 1)), ValueList((1, 2)), 1),
        (ValueList((IntRange(1, 5), IntRange(7, 9))), ValueList((IntRange(2, 4), IntRange(4, 8))),
         ValueList((IntRange(2, 4), IntRange(4, 5), IntRange(7, 8)))),
        (IntRange(-16, 16, 4), IntRange(-24, 24, 6), IntRange(-12, 12, 12)),
        (ValueArray(()), ValueArray(()), ValueArray(())),
    ],
)  # fmt: skip
def test_intersection_keeps_types_and_repeats(left: Value, right: Value, common: Value | None) -> None:
    """Widths never meet, flags meet where they agree, and a value that is repeated on both sides stays so."""
    found = intersect_values(left, right)
    assert found == common
    assert type(found) is type(common)


@pytest.mark.parametrize(
    ("inner", "outer", "contained"),
    [
        (IntRange(1, 3), ValueList((1, 2, 3)), True),
        (IntRange(1, 10), ValueList((IntRange(1, 5), IntRange(6, 10))), True),
        (IntRange(1, 10), ValueList((IntRange(1, 5), IntRange(7, 10))), False),
        (ValueList((IntRange(1, 2), 3)), IntRange(1, 3), True),
        (FloatRange(1.0, 2.0), ValueList((FloatRange(1.0, 1.5), FloatRange(1.5, 2.0))), True),
        (FlagSet(0xF, 0xF), FlagSet(3, 3), True),
        (FlagSet(3, 3), FlagSet(0xF, 0xF), False),
        (IntRange(0, 6, 6), IntRange(0, 12, 4), False),
        (IntRange(0, 12, 12), IntRange(0, 12, 4), True),
        (Int64(1), IntRange(0, 3), False),
        (ValueList(()), 1, True),
        (1, ValueList(()), False),
    ],
)
def test_several_members_together_may_contain_a_range(inner: Value, outer: Value, contained: bool) -> None:
    """The members of a list together count, not each one alone."""
    assert is_subset_value(inner, outer) is contained


@pytest.mark.parametrize(
    ("left", "right", "equal"),
    [
        (ValueList((1, 2)), ValueList((2, 1)), True),
        (ValueList((1, 1, 2)), ValueList((1, 2, 2)), False),
        (ValueList((1, 1)), 1, True),
        (ValueList((IntRange(1, 2),)), IntRange(1, 2), True),
        (ValueList(()), 1, False),
        (ValueArray((1, 2)), ValueArray((2, 1)), False),
        (ValueArray((ValueList((1, 2)), 3)), ValueArray((ValueList((2, 1)), 3)), True),
        (Int64Range(Int64(0), Int64(9)), IntRange(0, 9), False),
        (ValueList((1, 1.0)), ValueList((1.0, 1)), True),
        (ValueList((1, 1)), ValueList((1.0, 1)), False),
    ],
)
def test_equality_is_that_of_lists_in_any_order(left: Value, right: Value, equal: bool) -> None:
    """Lists are equal in any order, arrays in theirs; a list of one value is that value."""
    assert values_equal(left, right) is equal
    assert values_equal(right, left) is equal
