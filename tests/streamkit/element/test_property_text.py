"""Conversion of text to property values."""

import enum
import re
import sys
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit import Caps, Choice
from streamkit.element.property_text import value_from_text
from streamkit.flow.caps_text import unquote_string


class Colour(enum.Enum):
    """Names and values differ."""

    RED = "r"
    GREEN = "g"


class Size(Choice):
    """Has numbers and labels."""

    FIXED = "fixed", 4
    RANDOM = "random", None, "Random size"


class Parts(enum.Flag):
    """Names of two words are written with dashes."""

    VIDEO = enum.auto()
    AUDIO = enum.auto()
    SOFT_VOLUME = enum.auto()


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (int, "12", 12),
        (int, "+5", 5),
        (int, "-0x10", -16),
        (int, "010", 8),
        (int, "9223372036854775807", 2**63 - 1),
        (float, "0.5", 0.5),
        (float, ".5", 0.5),
        (float, "1e3", 1000.0),
        (float, "2", 2.0),
        (float, "MAX", sys.float_info.max),
        (float, "min", -sys.float_info.max),
        (bool, "t", True),
        (bool, "YES", True),
        (bool, "0", False),
        (Fraction, "30/1", Fraction(30)),
        (Fraction, "30", Fraction(30)),
        (Caps, "video/x-raw,width=[1,2]", Caps("video/x-raw, width=[ 1, 2 ]")),
        (Caps, "", Caps()),
        (str, "as it is", "as it is"),
        (str, '"quoted"', "quoted"),
        (Colour, "r", Colour.RED),
        (Size, "fixed", Size.FIXED),
        (Size, "4", Size.FIXED),
        (Size, "Random size", Size.RANDOM),
        (Size, "5", Size.RANDOM),
        (Size, " 0x5", Size.RANDOM),
        (int, " 5", 5),
        (float, " 5", 5.0),
        (Parts, "", Parts(0)),
        (Parts, "video+soft-volume", Parts.VIDEO | Parts.SOFT_VOLUME),
        (Parts, "0x5", Parts.VIDEO | Parts.SOFT_VOLUME),
        (int, "MIN", -(2**63)),
        (int, "max", 2**63 - 1),
        (int, "big_endian", 4321),
        (int, "byte_order", {"little": 1234, "big": 4321}[sys.byteorder]),
        (Colour, "1", Colour.GREEN),
    ],
)
def test_texts(kind: type, text: str, value: Any) -> None:
    """C integers, GStreamer's booleans, fractions, caps, flags, and enums by word, label or number."""
    assert value_from_text(kind, text) == value


@pytest.mark.parametrize(
    ("minimum", "maximum", "text", "value"),
    [
        (0, 2**32 - 1, "-1", 2**32 - 1),
        (0, 2**64 - 1, "-1", 2**64 - 1),
        (0, 2**64 - 1, "max", 2**64 - 1),
        (0, 2**64 - 1, "18446744073709551615", 2**64 - 1),
        (0, 100, "-1", -1),
        (-1, 2**31 - 1, "0xFFFFFFFF", -1),
        (-1, 2**31 - 1, "99999999999", 99999999999),
        (-1, 2**31 - 1, "18446744073709551615", -1),
        (None, None, "-1", -1),
    ],
)
def test_integers_wrap_at_the_width_of_their_range(
    minimum: int | None, maximum: int | None, text: str, value: int
) -> None:
    """As in C, where the largest value is that of 32 or 64 bits; any other range is left to the check."""
    assert value_from_text(int, text, minimum=minimum, maximum=maximum) == value


@pytest.mark.parametrize(
    ("kind", "text", "rule"),
    [
        (int, "1.5", "it takes a whole number such as 12, -1 or 0x10"),
        (int, "5 ", "it takes a whole number such as 12, -1 or 0x10"),
        (int, "1 2", "it takes a whole number such as 12, -1 or 0x10"),
        (int, "", "it takes a whole number such as 12, -1 or 0x10"),
        (int, "9223372036854775808", "it takes a number of at most 64 bits"),
        (int, "9" * 5000, "it takes a whole number such as 12, -1 or 0x10"),
        (float, "1/2", "it takes a number such as 0.5 or 1e3"),
        (float, "nan", "it takes a number such as 0.5 or 1e3"),
        (float, "1e999", "it takes a number such as 0.5 or 1e3"),
        (bool, "on", "it takes true, yes, t, 1 or false, no, f, 0"),
        (Fraction, "29.97", "it takes a fraction such as 30/1"),
        (Fraction, "1/0", "it takes a fraction such as 30/1"),
        (Colour, "Red", "it takes r, g"),
        (Colour, "2", "it takes r, g"),
        (Colour, "GREEN", "it takes r, g"),
        (Size, "0", "it takes fixed, random"),
        (Size, "FIXED", "it takes fixed, random"),
        (Parts, "video+nosuch", "it takes any of video, audio, soft-volume, joined by +"),
        (Parts, "8", "it takes any of video, audio, soft-volume, joined by +"),
        (Parts, "video+", "it takes any of video, audio, soft-volume, joined by +"),
        (str, '"', "its quotes must be closed, and quotes inside them escaped"),
        (str, '"a"b"', "its quotes must be closed, and quotes inside them escaped"),
        (str, r'"a\"', "its quotes must be closed, and quotes inside them escaped"),
        (str, r'"\19"', r"an octal escape has three digits, \000 to \377"),
        (str, r'"\377"', "its octal escapes must make UTF-8"),
        (list, "1", "values of type list cannot be written in a description"),
    ],
)
def test_errors_state_the_rule(kind: type, text: str, rule: str) -> None:
    """The caller adds element and property."""
    with pytest.raises(ValueError, match=f"^{re.escape(rule)}$"):
        value_from_text(kind, text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("plain", "plain"),
        ('"a b"', "a b"),
        (r'"a\ b"', "a b"),
        (r'"\101\102"', "AB"),
        (r'"t\303\274t\9"', "tüt9"),
        (r'"\"ü\""', '"ü"'),
        ('"', None),
        ('""', ""),
        ('"open', '"open'),
        (r"a\ b", r"a\ b"),
    ],
)
def test_strings_lose_one_pair_of_quotes(text: str, value: str | None) -> None:
    """Escapes are resolved between quotes only."""
    if value is None:
        with pytest.raises(ValueError, match="quotes"):
            unquote_string(text)
    else:
        assert unquote_string(text) == value


@given(st.sampled_from([int, float, bool, str, Fraction, Caps, Colour]), st.text(max_size=20))
@settings(max_examples=100)
def test_any_text_is_a_value_or_a_value_error(kind: type, text: str) -> None:
    """No text raises another exception."""
    try:
        value = value_from_text(kind, text)
    except ValueError:
        return
    assert isinstance(value, kind)
