"""Text of caps: what is read, how it is written, where errors point."""

import re
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit.errors import CapsSyntax
from streamkit.flow.caps import Caps
from streamkit.flow.caps_text import read_boolean, read_fraction, read_integer
from streamkit.flow.caps_values import FloatRange, FractionRange, IntRange, Value, ValueArray, ValueList


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("320", 320),
        ("0x10", 16),
        ("010", 8),
        ("-5", -5),
        ("1.5", 1.5),
        ("1e3", 1000.0),
        ("30/1", Fraction(30)),
        ("yes", True),
        ("TRUE", True),
        ("320px", "320px"),
        ("GRAY8", "GRAY8"),
        ("(fraction)30", Fraction(30)),
        ("(string)320", "320"),
        ("(s)320", "320"),
        ("(double)2", 2.0),
        ("(boolean)0", False),
        ("(buffer)00fF", b"\x00\xff"),
        ('"a b"', "a b"),
        (r'"say \"hi\""', 'say "hi"'),
        ("[ 1, 4096 ]", IntRange(1, 4096)),
        ("[ 0, 16, 4 ]", IntRange(0, 16, 4)),
        ("[ 1, max ]", IntRange(1, 2**31 - 1)),
        ("[ min, 0 ]", IntRange(-(2**31), 0)),
        ("[ 0.5, 1.0 ]", FloatRange(0.5, 1.0)),
        ("(double)[ 0, 1 ]", FloatRange(0.0, 1.0)),
        ("(fraction)[ 0, max ]", FractionRange(Fraction(0), Fraction(2**31 - 1))),
        ("(fraction)[ 1/100, 100 ]", FractionRange(Fraction(1, 100), Fraction(100))),
        ("{ GRAY8, BGR }", ValueList(("GRAY8", "BGR"))),
        ("{ 1, [ 2, 3 ] }", ValueList((1, IntRange(2, 3)))),
        ("{ }", ValueList(())),
        ("< 1, 2 >", ValueArray((1, 2))),
        ("(int)< { 1, 2 }, 3 >", ValueArray((ValueList((1, 2)), 3))),
    ],
)
def test_values(text: str, value: Value) -> None:
    """Untyped text is tried as int, double, fraction, boolean, string; a type in front decides."""
    found = Caps(f"a/b, field={text}")["field"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("text", "position", "rule"),
    [
        ("", 0, "expected a media type such as video/x-raw, got 'the end'"),
        ("video/x-raw, width", 18, "expected '=' after the field 'width'"),
        ("video/x-raw, width=", 19, "expected a value, got 'the end'"),
        ("video/x-raw width=3", 12, "expected ',' or ';' between fields and structures"),
        ("video/x-raw, width=[ 1 ]", 19, "a range has two ends and at most a step, got 1 values"),
        ("video/x-raw, width=[ 9, 1 ]", 19, "a range's low end must be below its high end, got [ 9, 1 ]"),
        ("video/x-raw, width=[ a, b ]", 19, "a range's ends must be numbers, got 'a'"),
        ("video/x-raw, width=[ 0, 4, a ]", 19, "a range's step must be an integer, got 'a'"),
        ("video/x-raw, width={ 1, 2", 25, "expected ',' or '}'"),
        ("video/x-raw, width={ , 2 }", 23, "expected a value before ','"),
        ("video/x-raw, rate=(fraction)x/0", 28, "'x/0' is no value of type fraction"),
        ("video/x-raw, rate=(fraction)1/0", 28, "'1/0' is no value of type fraction"),
        ("video/x-raw, rate=(int 3", 23, "expected ')' after the type name"),
        ("video/x-raw(memory:A", 20, "expected ')' after the caps features"),
        ('video/x-raw, a="b', 15, "expected a closing quote, got '\"b'"),
        ("video/x-raw,, a=1", 12, "expected a field name, got ', a=1'"),
        ("a/b, f=" + "{" * 40, 24, "values nest at most 16 deep"),
    ],
)
def test_an_error_says_where_and_which_rule(text: str, position: int, rule: str) -> None:
    """The message quotes the text, the place and the rule; `position` is the place for programs."""
    message = re.escape(f"caps {text!r}, at character {position}: {rule}")
    with pytest.raises(CapsSyntax, match=f"^{message}$") as caught:
        Caps(text)
    assert caught.value.position == position


def test_an_unknown_type_lists_the_known_ones() -> None:
    """The remedy stands in the message."""
    with pytest.raises(CapsSyntax, match=r"no type 'antwerp'; types are .*bitmask, .*, fraction, .*string"):
        Caps("a/b, f=(antwerp)1")


@pytest.mark.parametrize("text", ["9" * 5000, "(int)" + "9" * 5000, "(fraction)1/" + "9" * 5000, "1e999"])
def test_numbers_without_end_are_refused_as_caps(text: str) -> None:
    """A number that Python does not convert, or that is infinite, is a fault of the text, not a crash."""
    with pytest.raises(CapsSyntax, match=r"is no value of type (int|double|fraction)$"):
        Caps(f"a/b, f={text}")


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("video/x-raw,width=320,format=GRAY8", "video/x-raw, width=(int)320, format=(string)GRAY8"),
        ("video/x-raw(memory:B,memory:A),a=1.5", "video/x-raw(memory:B, memory:A), a=(double)1.5"),
        ("video/x-raw(memory:SystemMemory)", "video/x-raw"),
        ("a/b,f=30/1; c/d,", "a/b, f=(fraction)30/1; c/d"),
        ("a/b, f=[1,9]", "a/b, f=(int)[ 1, 9 ]"),
        ("a/b, f={ yes, no }", "a/b, f=(boolean){ true, false }"),
        ('a/b, f="a b"', r'a/b, f=(string)"a\ b"'),
        ("ANY", "ANY"),
        ("NONE", "EMPTY"),
    ],
)
def test_the_text_written_is_gstreamers(text: str, written: str) -> None:
    """Types in front, blanks inside brackets, other characters quoted and escaped."""
    assert str(Caps(text)) == written


def test_the_last_of_equal_fields_wins() -> None:
    """As in GStreamer a field given twice has its last value."""
    assert Caps("a/b, f=1, f=2")["f"] == 2


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


@given(st.text(max_size=60) | st.text(alphabet='ab/,;=(){}[]<>"\\ 0129.-:', max_size=60))
@settings(max_examples=150, deadline=None, derandomize=True)
def test_any_text_is_caps_or_a_clear_error(text: str) -> None:
    """Reading never raises anything but CapsSyntax, and what is read can be written and read again."""
    caps, position = None, 0
    try:
        caps = Caps(text)
    except CapsSyntax as error:
        position = error.position
    assert 0 <= position <= len(text)
    assert caps is None or Caps(str(caps)) == caps
