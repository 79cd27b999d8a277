"""Values of caps fields: ranges and flag sets."""

import re
from fractions import Fraction

import pytest

from streamkit.flow.caps_algebra import is_fixed
from streamkit.flow.caps_values import (
    FlagSet,
    FloatRange,
    FractionRange,
    Int64,
    Int64Range,
    IntRange,
    ValueArray,
    ValueList,
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
def test_invalid_ranges_are_refused(make: object, message: str) -> None:
    """The error states the rule."""
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


def test_a_wide_range_holds_wide_numbers_only() -> None:
    """The width is part of the type, as in GStreamer."""
    assert Int64(4) in Int64Range(Int64(0), Int64(8), 4)
    assert 4 not in Int64Range(Int64(0), Int64(8), 4)
    assert Int64(4) not in IntRange(0, 8, 4)


def test_flags_outside_the_mask_are_undecided() -> None:
    """They are left out when the set is made; more than 32 are refused."""
    assert FlagSet(0xFF, 0x0F) == FlagSet(0x0F, 0x0F)
    with pytest.raises(ValueError, match=r"^flags and mask have 32 bits, got 100000000:1$"):
        FlagSet(1 << 32, 1)


def test_what_is_fixed() -> None:
    """Ranges and lists are choices; arrays are where a member is; flags are where all are decided."""
    assert not is_fixed(ValueList((1,)))
    assert is_fixed(ValueArray((1, 2)))
    assert not is_fixed(ValueArray((IntRange(1, 2),)))
    assert is_fixed(FlagSet(1, 0xFFFFFFFF))
    assert not is_fixed(FlagSet(1, 3))
