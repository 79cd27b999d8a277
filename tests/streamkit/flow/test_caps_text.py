"""Text of simple values, read as their types."""

from fractions import Fraction

import pytest

from streamkit.flow.caps_text import READERS, TYPES, read_boolean, read_fraction, read_integer, read_untyped
from streamkit.flow.caps_values import DateTime, FlagSet, NullText, Value


def test_simple_readers() -> None:
    """Integers in C notation, fractions with a denominator that is not 0, booleans in all spellings."""
    assert [read_integer(text) for text in ("+7", "0X1f", "08", "1.0", "")] == [7, 31, None, None, None]
    assert [read_fraction(text) for text in ("3/4", "3", "3/0", "max", "x")] == [
        Fraction(3, 4), Fraction(3), None, Fraction(2**31 - 1), None,
    ]  # fmt: skip
    assert [read_boolean(text) for text in ("T", "yes", "0", "no", "maybe")] == [
        True,
        True,
        False,
        False,
        None,
    ]


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        ("int", "0x80000000", -(2**31)),
        ("int", "4294967295", -1),
        ("int", "0xFFFFFFFF80000000", -(2**31)),
        ("int", "0xFFFFFFFFFFFFFFFF", -1),
        ("int", "0xF000000000000000", None),
        ("int", "4294967296", None),
        ("int", "-2147483649", None),
        ("int", "max", 2**31 - 1),
        ("int", "MIN", -(2**31)),
        ("int", "little_endian", 1234),
        ("int", "Big_Endian", 4321),
        ("int", "", None),
        ("uint", "-1", 2**32 - 1),
        ("uint", "-", None),
        ("uint", "max", 2**32 - 1),
        ("guchar", "-1", 255),
        ("guchar", "256", None),
        ("gint64", "12345678901", 12345678901),
        ("gint64", "0xFFFFFFFFFFFFFFFF", -1),
        ("guint64", "-1", 2**64 - 1),
        ("guint64", "0x10000000000000000", None),
        ("float", "0.1", 0.10000000149011612),
        ("float", "1e40", None),
        ("double", "max", 1.7976931348623157e308),
        ("double", "0x1p3", 8.0),
        ("double", "nan", None),
        ("double", "1e999", None),
        ("fraction", "1/max", Fraction(1, 2**31 - 1)),
        ("fraction", "min", Fraction(-(2**31) + 1)),
        ("fraction", "1/-2", Fraction(-1, 2)),
        ("fraction", "99999999999/1", None),
        ("fraction", "29.97", None),
        ("flagset", "ffd81d:fffff0", FlagSet(0xFFD810, 0xFFFFF0)),
        ("flagset", "f:3:+abc/def", FlagSet(3, 3)),
        ("flagset", "g:3", None),
        ("bitmask", "0x3", 3),
        ("bitmask", "zz", None),
        ("buffer", "AABB", b"\xaa\xbb"),
        ("buffer", "AAB", None),
        ("date", "2020-13-02", None),
        ("datetime", "2020-01-02T03:04:05Z", DateTime("2020-01-02T03:04:05Z")),
        ("datetime", "yesterday", None),
        ("string", "NULL", NullText("NULL")),
        ("string", '"NULL"', "NULL"),
        ("string", '"', None),
        ("string", '"a\\054\\303\\274"', "a,\u00fc"),
        ("string", '"Hello', '"Hello'),
        ("string", "\udc80", None),
    ],
)
def test_each_type_reads_its_own_words(kind: str, text: str, value: Value | None) -> None:
    """Numbers that fit the bits otherwise signed wrap, as in GStreamer; what fits no way is refused."""
    assert READERS[kind](text) == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("4294967296", 4294967296.0), ("08", 8.0), ("0x", "0x"), ("--5", "--5"), ("b:c", FlagSet(8, 12)),
        ("f:3:x", "f:3:x"), ("1/0", "1/0"), ("nan", "nan"), ("max", 2**31 - 1), ("t", True),
        ("18446744073709551615", -1), ("99999999999/1", None), ("1e999", None),
    ],
)  # fmt: skip
def test_an_untyped_value_takes_the_first_type_that_fits(text: str, value: Value | None) -> None:
    """int, double, fraction, flag set, boolean, string."""
    found = read_untyped(text, text)
    assert found == value
    assert type(found) is type(value)


def test_every_name_of_a_type_leads_to_a_reader() -> None:
    """Abbreviations and C names mean the same as the word that is written."""
    assert {TYPES[name] for name in TYPES} - {"structure", "GstCaps"} == set(READERS)
    assert TYPES["i"] == TYPES["gint"] == "int"
