"""Values of caps fields: ranges, lists, arrays; what they share, contain and become."""

import re
from fractions import Fraction

import pytest

from streamkit.flow.caps_algebra import intersect_values, is_subset_value, same_type_equal
from streamkit.flow.caps_fixate import fixate_value
from streamkit.flow.caps_values import (
    FloatRange,
    FractionRange,
    IntRange,
    Value,
    ValueArray,
    ValueList,
    is_fixed,
    is_int,
)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: IntRange(5, 5), "a range's low end must be below its high end, got [ 5, 5 ]"),
        (lambda: IntRange(0, 8, 0), "a range's step must be at least 1, got 0"),
        (lambda: IntRange(1, 8, 2), "a range's ends must be multiples of its step 2"),
        (lambda: FloatRange(2.0, 1.0), "a range's low end must be below its high end, got [ 2.0, 1.0 ]"),
        (
            lambda: FloatRange(float("nan"), 1.0),
            "a range's low end must be below its high end, got [ nan, 1.0 ]",
        ),
        (
            lambda: FractionRange(Fraction(2), Fraction(1)),
            "a range's low end must be below its high end, got [ 2, 1 ]",
        ),
    ],
)  # fmt: skip
def test_a_range_without_width_is_refused(make: object, message: str) -> None:
    """Low end below high end, ends on the step: anything else says which rule was broken."""
    assert callable(make)
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        make()


def test_a_range_holds_values_of_its_own_type_only() -> None:
    """An int range holds ints on its step, no floats, no booleans; likewise the other ranges."""
    assert 4 in IntRange(0, 8, 4)
    assert 6 not in IntRange(0, 8, 4)
    assert 4.0 not in IntRange(0, 8, 4)
    assert True not in IntRange(0, 8)
    assert 0.5 in FloatRange(0.0, 1.0)
    assert 1 not in FloatRange(0.0, 1.0)
    assert Fraction(1, 2) in FractionRange(Fraction(0), Fraction(1))
    assert 1 not in FractionRange(Fraction(0), Fraction(1))


def test_equality_keeps_the_types_apart() -> None:
    """1, 1.0, True and 1/1 are equal in Python; in caps they are four values."""
    values: list[Value] = [1, 1.0, True, Fraction(1), "1"]
    for i, left in enumerate(values):
        assert [same_type_equal(left, right) for right in values] == [i == j for j in range(len(values))]
    assert is_int(1)
    assert not is_int(True)


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
        (ValueList((1, 1, 1)), ValueList((1, 1)), 1),
        (ValueList(()), 1, None),
        (ValueArray((ValueList((1, 2)), 3)), ValueArray((1, 3)), ValueArray((1, 3))),
        (ValueArray((1, 2)), ValueArray((1, 2, 3)), None),
        (ValueArray((1, 2)), 1, None),
    ],
)  # fmt: skip
def test_intersection(left: Value, right: Value, common: Value | None) -> None:
    """What both allow is left, in the order of the left one; one remaining value stands bare."""
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
    """A value is a subset where everything it allows is allowed by the other."""
    assert is_subset_value(inner, outer) is contained


@pytest.mark.parametrize(
    ("value", "near", "fixed"),
    [
        (IntRange(16, 4096), None, 16),
        (IntRange(16, 4096), 320, 320),
        (IntRange(16, 4096), 5000, 4096),
        (IntRange(16, 4096), 1, 16),
        (IntRange(0, 100, 10), 37, 30),
        (IntRange(16, 4096), "wide", 16),
        (ValueList(("NV12", "I420")), None, "NV12"),
        (ValueList(("NV12", "I420")), "I420", "I420"),
        (ValueList((100, 300, 500)), 320, 300),
        (ValueList((IntRange(0, 10), 50)), 12, 10),
        (ValueList((IntRange(0, 10), 50)), 7, 7),
        (FloatRange(0.0, 1.0), 2.0, 1.0),
        (FractionRange(Fraction(1), Fraction(60)), Fraction(25), Fraction(25)),
        (ValueArray((IntRange(1, 2), ValueList((3, 4)))), None, ValueArray((1, 3))),
        ("fixed", "other", "fixed"),
    ],
)
def test_fixation(value: Value, near: Value | None, fixed: Value) -> None:
    """One value is picked: the one nearest to what is wanted, else the first or the lowest."""
    found = fixate_value(value, near)
    assert found == fixed
    assert is_fixed(found)


def test_a_wish_that_is_no_single_value_does_not_unfix() -> None:
    """Near a range, fixation still ends in one value."""
    assert is_fixed(fixate_value(ValueList((IntRange(0, 100), 500)), IntRange(10, 20)))


def test_what_allows_nothing_stays_as_it_is() -> None:
    """An empty list has no value to pick: it stays and is not fixed."""
    assert fixate_value(ValueList(())) == ValueList(())
    assert not is_fixed(ValueList(()))
    assert fixate_value(ValueList(()), near=3) == ValueList(())
