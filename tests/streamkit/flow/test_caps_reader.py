"""Parsing of caps, and places of errors."""

import re
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit.errors import CapsSyntax
from streamkit.flow.caps import Caps, Structure, read_value
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
        ("{ , }", ValueList(())),
        ("{ , 1, 2, }", ValueList((1, 2))),
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
        ("video/x-raw, width={ ,, 2 }", 22, "expected a value, got ', 2 }'"),
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
def test_too_large_numbers_are_refused(text: str) -> None:
    """A syntax error, not a crash."""
    with pytest.raises(CapsSyntax, match=r"is no value of type (int|double|fraction)$"):
        Caps(f"a/b, f={text}")


def test_the_last_of_equal_fields_wins() -> None:
    """As in GStreamer a field given twice has its last value."""
    assert Caps("a/b, f=1, f=2")["f"] == 2


@given(st.text(max_size=60) | st.text(alphabet='ab/,;=(){}[]<>"\\ 0129.-:', max_size=60))
@settings(max_examples=150)
def test_any_text_is_caps_or_a_clear_error(text: str) -> None:
    """Only CapsSyntax is raised, and parsed caps can be written and parsed again."""
    caps, position = None, 0
    try:
        caps = Caps(text)
    except CapsSyntax as error:
        position = error.position
    assert 0 <= position <= len(text)
    assert caps is None or Caps(str(caps)) == caps


NESTED = Structure("s", {"x": 1})


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("[s, x=1]", NESTED),
        ("[ s , x=1; ]", NESTED),
        ("(structure)[s, x=1]", NESTED),
        (r'(structure)"s\,\ x\=\(int\)1\;"', NESTED),
        ("(structure)s", Structure("s")),
        ("[min, x=1]", Structure("min", {"x": 1})),
        ("{ [s, x=1], [s, x=1] }", ValueList((NESTED, NESTED))),
        ("[s, x=[t, y=[ 1, 2 ]]]", Structure("s", {"x": Structure("t", {"y": IntRange(1, 2)})})),
        ("[s(memory:A), x=1; t]", Caps("s(memory:A), x=1; t")),
        ("(GstCaps)[s, x=1; t]", Caps("s, x=1; t")),
        ("(GstCaps)ANY", Caps("ANY")),
        ("(GstCaps)[EMPTY]", Caps("EMPTY")),
        ('(GstCaps)"s, x=1"', Caps("s, x=1")),
    ],
)
def test_structures_and_caps_are_values(text: str, value: Value) -> None:
    """Brackets nest; features tell caps from a structure; a string with a type nests too."""
    found = Caps(f"a/b, field={text}")["field"]
    assert type(found) is type(value)
    assert found == value
    assert str(Caps(f"a/b, field={text}")) == str(Caps(str(Caps(f"a/b, field={text}"))))


@pytest.mark.parametrize(
    ("text", "name", "features"),
    [
        ('"video/x-raw"', "video/x-raw", ()),
        ("a/b()", "a/b", ()),
        ("a/b(memory:SystemMemory)", "a/b", ()),
        ("a/b(memory:B, memory:A, memory:B)", "a/b", ("memory:B", "memory:A")),
        ("a/b(memory:SystemMemory, meta:X)", "a/b", ("memory:SystemMemory", "meta:X")),
        ("a/b(ANY)", "a/b", ("ANY",)),
        (r"\ a/b\ ", "a/b", ()),
        ("a/b;", "a/b", ()),
        ("a/b,", "a/b", ()),
    ],
)
def test_names_and_features(text: str, name: str, features: tuple[str, ...]) -> None:
    """A name may be quoted; features are kept in order, once each; memory of the system alone is none."""
    (structure,) = Caps(text).structures
    assert (structure.name, structure.features, dict(structure.fields)) == (name, features, {})


@pytest.mark.parametrize(
    "text",
    [
        "1a/b", "a/b (memory:A)", "a/b(foo)", "a/b(memory:A", "a/b(memory:A,)", "a/b(ANY, memory:A)",
        "a/b,,f=1", "a/b,f=1,,", "a/b;;c/d", ";a/b", "a/b, f=[ 1, 2.0 ]", "a/b, f=[ 1.0, 2.0, 1.0 ]",
        "a/b, f=(uint)[ 1, 2 ]", "a/b, f=(float)[ 1, 2 ]", "a/b, f=(string)[ 1, 2 ]", "a/b, f=[ 0, 1, -1 ]",
        "a/b, f=[ 1, 2, 0 ]", "a/b, f=[ 1, 4, 2 ]", "a/b, f=[]", "a/b, f=[ 1, 2, ]", "a/b, f={ 1,, }",
        "a/b, f={ 1 2 }", "a/b, f=(int)(int)5", 'a/b, f=(int)"5"', "a/b, f=(int)[s(some:Feature)]",
        "a/b, f=[s, x=1; t]", "a/b, f=[ANY]", "ANY, f=1", "a/b; ANY", 'a/b, f="x', "a/b, f=$x", "a/b, f=1\\",
        'a/b, f=(string)"\\380"', 'a/b, f=(string)"\\000"', 'a/b, f=(string)"\\377"',
        'a/b, f=(structure)"s, x="',
    ],
)  # fmt: skip
def test_invalid_caps(text: str) -> None:
    """The error has the place in the text."""
    with pytest.raises(CapsSyntax) as caught:
        Caps(text)
    assert 0 <= caught.value.position <= len(text)
    assert caught.value.rule


def test_an_unknown_type_gets_a_suggestion() -> None:
    """The hint names the nearest type, and position and length are those of the word."""
    with pytest.raises(CapsSyntax) as caught:
        Caps("a/b, f=(fractoin)1")
    assert caught.value.hint == 'did you mean "fraction"?'
    assert (caught.value.position, caught.value.length) == (8, 8)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("a" * 70_000, "caps text of 70000 characters: at most 65536 are read"),
        ("a;" * 600, "caps have at most 512 structures"),
        (
            "a/b, f={" + "[ 1, 2 ]," * 600 + "}",
            "lists that hold more than plain values have at most 256 members",
        ),
        (
            "a/b, "
            + ", ".join(f'{name}=(structure)"s, f={{ {"[ 1, 2 ]," * 199}[ 1, 2 ] }}"' for name in "fg"),
            "no structure: lists that hold more than plain values have at most 256 members",
        ),
        ("a/b, f=" + "[s, f=" * 30, "values nest at most 16 deep"),
        ("a/b, f=" + "{ <" * 30, "values nest at most 16 deep"),
    ],
)
def test_limits(text: str, rule: str) -> None:
    """Length, number and depth are bounded; messages are short."""
    with pytest.raises(CapsSyntax) as caught:
        Caps(text)
    assert caught.value.rule == rule
    assert len(str(caught.value)) < 600


def test_nesting_in_strings_is_limited() -> None:
    """A string that contains a structure is one level."""
    text = "s"
    for _ in range(11):
        quoted = re.sub(r'(["\\])', r"\\\1", text)
        text = f's, f=(structure)"{quoted}"'
    within = "a/b, f=" + "{" * 6 + f"[{text}]" + "}" * 6
    with pytest.raises(CapsSyntax, match=r"values nest at most 16 deep"):
        Caps(within)
    assert str(Caps('a/b, f={ { (structure)"s\\,\\ x\\=1" } }')) == (
        "a/b, f=(structure){ { (structure)[s, x=(int)1;] } }"
    )


def test_a_single_value_is_parsed() -> None:
    """Text after it is an error."""
    assert read_value("[16, 96, 16]") == IntRange(16, 96, 16)
    with pytest.raises(CapsSyntax, match=r"expected the end after the value$"):
        read_value("1 2")
