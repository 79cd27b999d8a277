"""Fixation of values."""

from fractions import Fraction

import pytest

from streamkit.flow.caps_algebra import fixate_value, is_fixed
from streamkit.flow.caps_values import (
    FlagSet,
    FloatRange,
    FractionRange,
    Int64,
    Int64Range,
    IntRange,
    Value,
    ValueArray,
    ValueList,
)


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
    """The value nearest to the given one, else the first or the lowest."""
    found = fixate_value(value, near)
    assert found == fixed
    assert is_fixed(found)


def test_fixation_near_a_range_is_fixed() -> None:
    """The result is one value."""
    assert is_fixed(fixate_value(ValueList((IntRange(0, 100), 500)), IntRange(10, 20)))


def test_an_empty_list_is_not_fixated() -> None:
    """There is no value to choose."""
    assert fixate_value(ValueList(())) == ValueList(())
    assert not is_fixed(ValueList(()))
    assert fixate_value(ValueList(()), near=3) == ValueList(())


def test_every_type_keeps_its_type() -> None:
    """A wide range gives a wide number, near or not; flags that are free become 0."""
    wide = Int64Range(Int64(4), Int64(12), 4)
    assert type(fixate_value(wide)) is Int64
    assert type(fixate_value(wide, Int64(9))) is Int64
    assert fixate_value(wide, Int64(9)) == 8
    assert fixate_value(wide, 9) == 4
    assert fixate_value(FlagSet(3, 3)) == FlagSet(3, 0xFFFFFFFF)
