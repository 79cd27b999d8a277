"""Tokens: the longest match wins."""

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit.graph.description_text import DescriptionLexer


def tokens(text: str) -> list[tuple[str, str]]:
    """Kind and text of each token."""
    return [(token.type, str(token)) for token in DescriptionLexer(None).lex(text)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("queue!queue", [("IDENTIFIER", "queue"), ("LINK", "!"), ("IDENTIFIER", "queue")]),
        ("num-buffers = 5", [("ASSIGNMENT", "num-buffers = 5")]),
        ("a=x!b", [("ASSIGNMENT", "a=x!b")]),
        ('a="x ! y" b', [("ASSIGNMENT", 'a="x ! y"'), ("IDENTIFIER", "b")]),
        (r'a="x\"y z"', [("ASSIGNMENT", r'a="x\"y z"')]),
        (r"a=x\ y b", [("ASSIGNMENT", r"a=x\ y"), ("IDENTIFIER", "b")]),
        ("a='x y' b", [("ASSIGNMENT", "a='x y'"), ("IDENTIFIER", "b")]),
        ('a="x y', [("ASSIGNMENT", 'a="x'), ("IDENTIFIER", "y")]),
        ("t. ! s.sink_1", [("REF", "t."), ("LINK", "!"), ("REF", "s.sink_1")]),
        ("a .src ! .sink b", [("IDENTIFIER", "a"), ("PADREF", ".src"), ("LINK", "!"), ("PADREF", ".sink"),
                              ("IDENTIFIER", "b")]),
        ("bin.(", [("BINREF", "bin.(")]),
        ("bin . ( )", [("BINREF", "bin . ("), ("CLOSE", ")")]),
        ("( a )", [("OPEN", "("), ("IDENTIFIER", "a"), ("CLOSE", ")")]),
        ("! video/x-raw, width=3 ! b", [("LINK", "! video/x-raw, width=3 !"), ("IDENTIFIER", "b")]),
        ("! a/b; c/d !", [("LINK", "! a/b; c/d !")]),
        (r"! a/b, s=x\!y !", [("LINK", r"! a/b, s=x\!y !")]),
        ("! a/b", [("LINK", "!"), ("IDENTIFIER", "a"), ("URL", "/b")]),
        ("d/x", [("URL", "d/x")]),
        ('file://"a b" c', [("URL", 'file://"a b"'), ("IDENTIFIER", "c")]),
        ("x://", [("URL", "x://")]),
        ("/", [("ILLEGAL", "/")]),
        (r"! a/b, s=x\! b", [("LINK", r"! a/b, s=x\!"), ("IDENTIFIER", "b")]),
        ("a=x\\\\ y", [("ASSIGNMENT", "a=x\\\\ y")]),
        ("a=x\\", [("ASSIGNMENT", "a=x\\")]),
        ("a=x\\\ny", [("ASSIGNMENT", "a=x\\"), ("IDENTIFIER", "y")]),
        ("a=x\u00a0y", [("ASSIGNMENT", "a=x\u00a0y")]),
        ("file:///a/b ! x", [("URL", "file:///a/b"), ("LINK", "!"), ("IDENTIFIER", "x")]),
        ("./a", [("URL", "./a")]),
        ("@preset=Fast", [("PRESET", "@preset=Fast")]),
        ("a,b", [("IDENTIFIER", "a"), ("COMMA", ","), ("IDENTIFIER", "b")]),
        ("100 1__x", [("IDENTIFIER", "100"), ("IDENTIFIER", "1__x")]),
        ("a &", [("IDENTIFIER", "a"), ("ILLEGAL", "&")]),
        ("ü", [("ILLEGAL", "ü")]),
        (" \t\n", []),
    ],
)  # fmt: skip
def test_tokens(text: str, expected: list[tuple[str, str]]) -> None:
    """As gst-launch cuts them; what fits nothing is one illegal character."""
    assert tokens(text) == expected


def test_offsets_are_those_of_the_text() -> None:
    """Errors point into the text by them."""
    text = "fakesrc  num-buffers=3\n ! fakesink"
    found = [(token.start_pos, token.end_pos) for token in DescriptionLexer(None).lex(text)]
    assert [text[start:end] for start, end in found] == ["fakesrc", "num-buffers=3", "!", "fakesink"]


@given(st.text(max_size=80) | st.text(alphabet="ab/!:;.,(){}=\"'\\ \n", max_size=80))
@settings(max_examples=150)
def test_every_character_is_in_one_token_or_blank(text: str) -> None:
    """Tokens do not overlap, and between them stand blanks only."""
    position = 0
    for token in DescriptionLexer(None).lex(text):
        assert token.start_pos is not None
        assert token.end_pos is not None
        assert text[position : token.start_pos].strip() == ""
        assert token.end_pos > token.start_pos
        assert str(token) == text[token.start_pos : token.end_pos]
        position = token.end_pos
    assert text[position:].strip() == ""


@pytest.mark.parametrize(
    "text",
    [
        "a ! " + ";".join(["aa/aaaa"] * 40),
        "! a/b " * 200,
        "a=" + "\\" * 4001,
        "a=" + '"' + '\\"' * 4000,
        ("x " + '"') * 3000,
        "a" * 20000,
        "a.\t" * 5000,
        ":a/b;" * 2000,
        "b," * 50_000,
    ],
)
def test_lexing_takes_linear_time(text: str) -> None:
    """For a few kilobytes of any repeated text."""
    begun = time.process_time()
    assert tokens(text)
    assert time.process_time() - begun < 5.0
