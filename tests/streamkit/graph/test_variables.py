"""Comments and variables, and places in the original text."""

import re

import pytest

from streamkit.errors import DescriptionError, Place
from streamkit.graph.description_text import expand, missing_variables


@pytest.mark.parametrize(
    ("text", "variables", "expanded"),
    [
        ("a ${X} b", {"X": "val"}, "a val b"),
        ("a ${X:-def} b", {}, "a def b"),
        ("a ${X:-def} b", {"X": "val"}, "a val b"),
        ("a ${X:-} b", {}, "a  b"),
        ("p=${X} b", {"X": "two words"}, r"p=two\ words b"),
        ('p="${X}" b', {"X": "two words"}, 'p="two words" b'),
        ("p=a${X}c", {"X": "b\\"}, r"p=ab\\c"),
        ("${X}", {"X": "queue ! queue"}, "queue ! queue"),
        ("a $X {X}", {"X": "1"}, "a $X {X}"),
        ("a # comment ! x\nb", {}, "a" + " " * 14 + "\nb"),
        ("p=a#b", {}, "p=a#b"),
        ('p="# no comment" b', {}, 'p="# no comment" b'),
        ("# ${X}\na", {}, "      \na"),
        ("a # no comment in one line", {}, "a # no comment in one line"),
        ('p="x\n# y ${X}\n" b # c', {"X": "1"}, 'p="x\n# y 1\n" b    '),
        ("p='x\n# y' # c", {}, "p='x\n# y'    "),
        ("p=a\\ # b\n", {}, "p=a\\ # b\n"),
        ("# don't \"quote\n# ${X:-1}'\na", {}, "              \n          \na"),
    ],
)
def test_expansion(text: str, variables: dict[str, str], expanded: str) -> None:
    """Values replace names, blanks in unquoted values are escaped, comments leave blanks."""
    assert expand(text, variables).text == expanded


@pytest.mark.parametrize(
    ("text", "message", "place"),
    [
        (
            "a ! ${Y}",
            "variable 'Y' has no value and no default; give it with --set Y=VALUE; given are NAME",
            Place(1, 5, 4),
        ),
        (
            "a\n ${NAMES}",
            "variable 'NAMES' has no value and no default; give it with --set NAMES=VALUE; given are NAME",
            Place(2, 2, 8),
        ),
        ("${} a", "'${}' names no variable: ${NAME} or ${NAME:-default}", Place(1, 1, 3)),
        ("${1a} a", "'${1a}' names no variable: ${NAME} or ${NAME:-default}", Place(1, 1, 5)),
    ],
)
def test_a_variable_without_a_value_is_an_error(text: str, message: str, place: Place) -> None:
    """With its place and the remedy."""
    with pytest.raises(DescriptionError, match=f"^{re.escape(message)}$") as caught:
        expand(text, {"NAME": "x"})
    assert caught.value.place == place
    assert caught.value.code == "syntax"


def test_places_point_into_the_text_as_written() -> None:
    """Behind a long or short value, and inside it, the place is the variable's own."""
    text = "a ${LONG} bcd\nef ${LONG} g"
    expanded = expand(text, {"LONG": "x" * 50})
    start = expanded.text.index("bcd")
    assert expanded.place(start, start + 3) == Place(1, 11, 3)
    start = expanded.text.index("x")
    assert expanded.place(start, start + 50) == Place(1, 3, 7)
    start = expanded.text.index("g")
    assert expanded.place(start, start + 1) == Place(2, 12, 1)


def test_the_expanded_length_is_limited() -> None:
    """Variables cannot make a text arbitrarily long."""
    with pytest.raises(DescriptionError, match=r"^a description has at most 1000000 characters$"):
        expand("${X}" * 1000, {"X": "x" * 10_000})


def test_a_text_that_is_too_long_is_not_searched() -> None:
    """Its length alone refuses it, also where variables would make it shorter."""
    with pytest.raises(DescriptionError, match="at most 1000000 characters"):
        expand("${x:-" + "a" * 1_000_000 + "}", {"x": ""})


def test_variables_without_a_value_are_found() -> None:
    """Each once; not those in comments, with a default, or given."""
    text = "# ${COMMENT}\na=${X} b=${Y:-1} c=${Z} d=${X} e=${Y}"
    assert missing_variables(text, {"Z": ""}) == ["X", "Y"]
