"""Normalized and simplified caps."""

import pytest

from streamkit.errors import CapsTooLarge
from streamkit.flow.caps import ANY, Caps


@pytest.mark.parametrize(
    ("text", "normal"),
    [
        (
            "a/b, f={ 1, 2 }, g={ 3, 4 }",
            "a/b, f=(int)1, g=(int)3; a/b, f=(int)2, g=(int)3; "
            "a/b, f=(int)1, g=(int)4; a/b, f=(int)2, g=(int)4",
        ),
        ("a/b, f={ 1, { 2, 3 } }; c/d", "a/b, f=(int)1; c/d; a/b, f=(int)2; a/b, f=(int)3"),
        ("a/b, f=< { 1, 2 }, 3 >", "a/b, f=(int)< { (int)1, (int)2 }, 3 >"),
        ("a/b, f={ }; c/d", "c/d"),
        ("ANY", "ANY"),
    ],
)  # fmt: skip
def test_normal_form(text: str, normal: str) -> None:
    """One structure per list entry, further ones appended; an empty list gives none."""
    assert str(Caps(text).normalize()) == normal


def test_a_too_large_normal_form_is_refused() -> None:
    """Forty fields of three values."""
    text = "a/b" + "".join(f", f{index}={{ 1, 2, 3 }}" for index in range(40))
    with pytest.raises(CapsTooLarge, match=r"^normalized the caps have more than 10000 structures$"):
        Caps(text).normalize()


@pytest.mark.parametrize(
    ("text", "simple"),
    [
        ("a/b, f=1; a/b, f=2; a/b, f=3", "a/b, f=(int){ 1, 2, 3 }"),
        ("a/b, f=[ 1, 5 ]; a/b, f=[ 6, 9 ]", "a/b, f=(int)[ 1, 9 ]"),
        ("a/b, f=[ 1, 3 ]; a/b, f=[ 7, 9 ]", "a/b, f=(int)[ 1, 3 ]; a/b, f=(int)[ 7, 9 ]"),
        ("a/b, f=[ 1, 5 ]; a/b, f=3", "a/b, f=(int)[ 1, 5 ]"),
        ("a/b, f=[ 0, 16, 4 ]; a/b, f=[ 0, 16, 8 ]", "a/b, f=(int)[ 0, 16, 4 ]"),
        ("a/b, f=8; a/b, f=[ 0, 16, 4 ]", "a/b, f=(int){ [ 0, 4, 4 ], [ 12, 16, 4 ], 8 }"),
        ("c/d; a/b", "a/b; c/d"),
        ("a/b; a/b, f=1", "a/b"),
        ("a/b, f=x; a/b, f=y; a/b, f=z, g=1", "a/b, f=(string)z, g=(int)1; a/b, f=(string){ x, y }"),
        (
            "a/b, f=x, g=1; a/b, f=y, g=1; a/b, f=x, g=2",
            "a/b, f=(string)x, g=(int){ 1, 2 }; a/b, f=(string)y, g=(int)1",
        ),
        ("a/b, f=1; a/b, f=x", "a/b, f=(int)1; a/b, f=(string)x"),
        ("a/b, f=[s, x=1]; a/b, f=[s, x=2]", "a/b, f=(structure)[s, x=(int){ 1, 2 };]"),
        (
            "a/b(memory:B), f=1; a/b(memory:A), f=1; a/b(memory:B), f=2",
            "a/b(memory:B), f=(int)1; a/b(memory:A), f=(int)1; a/b(memory:B), f=(int)2",
        ),
        ("a/b(memory:A); a/b(ANY)", "a/b(ANY)"),
        ("a/b(ANY), f=1; a/b", "a/b(ANY), f=(int)1; a/b"),
        ("EMPTY", "EMPTY"),
        ("ANY", "ANY"),
    ],
)
def test_simple_form(text: str, simple: str) -> None:
    """Sorted by name; subsets are removed, and structures that differ in one field are merged."""
    assert str(Caps(text).simplify()) == simple


def test_any_has_no_other_form() -> None:
    """It stays what it is."""
    assert ANY.normalize() is ANY
    assert ANY.simplify() is ANY
