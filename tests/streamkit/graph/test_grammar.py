"""The tables of the parser belong to the grammar beside them."""

import hashlib

import pytest

from streamkit.graph import grammar_tables
from streamkit.graph.grammar import build_parser, grammar_text, parser


def test_tables_are_of_this_grammar() -> None:
    """Run `python -m streamkit.graph.grammar` after a change of grammar.lark."""
    assert hashlib.sha256(grammar_text().encode()).hexdigest() == grammar_tables.GRAMMAR_SHA256


@pytest.mark.parametrize(
    "text",
    [
        "a",
        "a b=c ! d",
        "a .src,x ! video/x-raw, width=3 ! .sink,y b name=q  q. ! c",
        "bin.( name=x a ! ( b ) ) ! c @preset=p ! file:///x",
        "q.src_1,src_2 : z",
    ],
)
def test_tables_parse_as_the_grammar_does(text: str) -> None:
    """The parser from the tables gives the same tree as the one made from the grammar."""
    assert parser().parse(text) == build_parser().parse(text)


def test_other_version_of_lark_builds_from_the_grammar(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables of another lark are not trusted."""
    monkeypatch.setattr(grammar_tables, "LARK_VERSION", "0.0")
    parser.cache_clear()
    try:
        assert parser().parse("a ! b") == build_parser().parse("a ! b")
    finally:
        parser.cache_clear()
