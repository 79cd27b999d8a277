"""Text of caps, in GStreamer's form."""

from datetime import date

import pytest

from streamkit.flow.caps import Caps
from streamkit.flow.caps_values import Float32, NullText, UChar, UInt64, Value, write_value


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


@pytest.mark.parametrize(
    "text",
    [
        "(int)-5", "(uint)4294967295", "(gint64)[ 0, 20, 5 ]", "(guint64)5", "(glong)5", "(gulong)5",
        "(guchar)255",
        "(double)0.10000000000000001", "(double)1", "(double)1e+22", "(float)0.10000000149011612",
        "(double)[ 1, 2 ]", "(fraction)[ -1/2, 2147483647/1 ]", "(fraction){ 30/1, 30000/1001 }",
        "(bitmask)0x0000000000000003", "(flagset)3:f", "(buffer)aabb", "(date)2020-01-02",
        "(datetime)2020-01",
        "(boolean)< true, false >", "(int){  }", "(int)<  >", "(int)< { (int)1, (int)2 }, 3 >",
        '(string)""', '(string)"NULL"', "(string)NULL", r'(string)"q\"q"', r'(string)"\303\274\012"',
        "(structure)[s, x=(int)1;]", "(structure){ [s;], [t, y=(structure)[u;];] }", "(GstCaps)[ANY]",
        "(GstCaps)[s(memory:A), x=(int)1; t]",
        "(GstVideoMultiviewFlagsSet)0:ffffffff:/right-view-first/left-flipped/left-flopped/right-flipped"
        "/right-flopped/half-aspect/mixed-mono",
        "(GstVideoMultiviewFlagsSet)1:3:+right-view-first/left-flipped",
    ],
)  # fmt: skip
def test_what_gstreamer_writes_is_written_again(text: str) -> None:
    """Every type in its own form, so that the same text comes back."""
    assert str(Caps(f"a/b, f={text}")) == f"a/b, f={text}"


def test_members_of_different_types_have_types() -> None:
    """So that a mixed list is parsed to the same value."""
    assert str(Caps("a/b, f={ 1, foo, 1.5 }")) == "a/b, f={ (int)1, (string)foo, (double)1.5 }"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (UChar(7), "(guchar)7"),
        (UInt64(7), "(guint64)7"),
        (Float32(0.5), "(float)0.5"),
        (date(2020, 1, 2), "(date)2020-01-02"),
        (NullText("NULL"), "(string)NULL"),
        (b"", '(buffer)""'),
        (True, "(boolean)true"),
    ],
)
def test_values_made_in_python_are_written_with_their_type(value: Value, text: str) -> None:
    """The type comes from the class of the value."""
    assert write_value(value) == text
