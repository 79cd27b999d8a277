"""Difference and union of values."""

from fractions import Fraction

import pytest

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps_algebra import Structure
from streamkit.flow.caps_simplify import subtract_values, unite_values
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
    ("minuend", "subtrahend", "left"),
    [
        (1, 1, None),
        (1, 2, 1),
        (1, IntRange(0, 5), None),
        (IntRange(1, 10), IntRange(1, 5), IntRange(6, 10)),
        (IntRange(1, 10), IntRange(4, 5), ValueList((IntRange(1, 3), IntRange(6, 10)))),
        (IntRange(1, 10), 10, IntRange(1, 9)),
        (IntRange(0, 16, 4), 8, ValueList((IntRange(0, 4, 4), IntRange(12, 16, 4)))),
        (IntRange(0, 16, 4), 5, IntRange(0, 16, 4)),
        (IntRange(0, 2), ValueList((0, 2)), 1),
        (IntRange(0, 16, 4), IntRange(0, 16, 8), IntRange(0, 16, 4)),
        (IntRange(0, 16, 8), IntRange(4, 12, 4), ValueList((0, 16))),
        (Int64Range(Int64(0), Int64(3)), Int64(0), Int64Range(Int64(1), Int64(3))),
        (ValueList((1, 2, 2, 3)), ValueList((1, 3)), ValueList((2, 2))),
        (ValueList((1, IntRange(3, 6))), IntRange(5, 9), ValueList((1, IntRange(3, 4)))),
        (FloatRange(0.0, 4.0), FloatRange(1.0, 2.0), ValueList((FloatRange(0.0, 1.0), FloatRange(2.0, 4.0)))),
        (FloatRange(0.0, 4.0), 1.0, FloatRange(0.0, 4.0)),
        (FractionRange(Fraction(0), Fraction(4)), FractionRange(Fraction(2), Fraction(9)),
         FractionRange(Fraction(0), Fraction(2))),
        ("x", ValueList(("x", "y")), None),
    ],
)  # fmt: skip
def test_difference(minuend: Value, subtrahend: Value, left: Value | None) -> None:
    """A hole that cannot be written leaves the value unchanged."""
    found = subtract_values(minuend, subtrahend)
    assert found == left
    assert type(found) is type(left)


@pytest.mark.parametrize(
    ("left", "right", "both"),
    [
        (IntRange(16, 32, 16), IntRange(32, 96, 16), IntRange(16, 96, 16)),
        (IntRange(16, 32, 16), IntRange(48, 96, 16), IntRange(16, 96, 16)),
        (IntRange(112, 192, 16), IntRange(48, 96, 16), IntRange(48, 192, 16)),
        (IntRange(16, 32, 16), IntRange(64, 96, 16), None),
        (IntRange(112, 192, 16), IntRange(48, 96, 8), None),
        (IntRange(10, 20, 5), 10, IntRange(10, 20, 5)),
        (25, IntRange(10, 20, 5), IntRange(10, 25, 5)),
        (IntRange(10, 20, 5), 5, IntRange(5, 20, 5)),
        (IntRange(1, 3), 7, None),
        (IntRange(1, 3), ValueList((5, 6)), ValueList((IntRange(1, 3), 5, 6))),
        (Int64Range(Int64(1), Int64(3)), Int64(4), ValueList((Int64Range(Int64(1), Int64(3)), Int64(4)))),
        (1, 2, ValueList((1, 2))),
        (1, 1, 1),
        (1, "x", None),
        (ValueList((1, 2)), ValueList((2, 3)), ValueList((1, 2, 3))),
        (FloatRange(1.0, 3.0), 5.0, ValueList((FloatRange(1.0, 3.0), 5.0))),
        (ValueArray((1,)), ValueArray((2,)), ValueList((ValueArray((1,)), ValueArray((2,))))),
        (FlagSet(0xF0010, 0xFFFF0), FlagSet(0x4F0000, 0xFF0000), FlagSet(0x4F0010, 0xFFFFF0)),
        (FlagSet(1, 3), FlagSet(2, 3), None),
        (Structure("s", {"x": 1}), Structure("s", {"x": 2}), Structure("s", {"x": ValueList((1, 2))})),
        (Structure("s"), Structure("t"), ValueList((Structure("s"), Structure("t")))),
    ],
)
def test_union(left: Value, right: Value, both: Value | None) -> None:
    """Ranges that overlap or border on each other join; the rest makes a list, or nothing as in GStreamer."""
    found = unite_values(left, right)
    assert found == both
    assert type(found) is type(both)


def test_a_too_large_union_is_refused() -> None:
    """More than a thousand ranges in one field."""
    left = ValueList(tuple(FloatRange(float(i), i + 0.5) for i in range(600)))
    right = ValueList(tuple(FloatRange(i + 0.6, i + 0.8) for i in range(600)))
    with pytest.raises(CapsTooLarge, match=r"^a field of the caps has more than 1000 alternatives$"):
        unite_values(left, right)
