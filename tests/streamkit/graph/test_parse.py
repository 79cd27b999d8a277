"""Parsing of descriptions, and places of errors."""

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit.errors import DescriptionError, Place
from streamkit.graph import parse as parse_module
from streamkit.graph.parse import (
    BinNode,
    ChainNode,
    ElementNode,
    FaultNode,
    ReferenceNode,
    UrlNode,
    parse,
    unquote_value,
)


def fault(chains: tuple[ChainNode, ...]) -> DescriptionError | None:
    """The error where the text stops fitting, which is the last thing in the tree."""
    last = chains[-1].nodes[-1]
    if isinstance(last, BinNode) and last.chains:
        return fault(last.chains)
    return last.error if isinstance(last, FaultNode) else None


def parsed(text: str) -> tuple[ChainNode, ...]:
    """The chains of a text that fits the grammar; else its error is raised."""
    chains = parse(text, {})
    found = fault(chains)
    if found is not None:
        raise found
    return chains


def test_a_chain_has_nodes_and_links_between_them() -> None:
    """Elements with their properties, filters on their links."""
    (chain,) = parse("fakesrc num-buffers=3 ! a/b, x=1 ! queue : fakesink", {})
    assert [node.factory for node in chain.nodes if isinstance(node, ElementNode)] == [
        "fakesrc",
        "queue",
        "fakesink",
    ]
    assert [(link.caps, link.every_pad) for link in chain.links] == [("a/b, x=1", False), ("", True)]
    first = chain.nodes[0]
    assert isinstance(first, ElementNode)
    assert [(item.name, item.value) for item in first.assignments] == [("num-buffers", "3")]


@pytest.fixture
def stored_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The file of the parser's tables, which is not there yet; bytecode is written."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(parse_module, "cache_from_source", lambda _: str(tmp_path / "grammar.pyc"))
    parse_module._parser.cache_clear()
    yield tmp_path / "grammar.lalr"
    parse_module._parser.cache_clear()


TEXT = "a.b ! c x=1 ! ( d ) t. ! e"


def test_stored_tables_parse_as_new_ones(stored_tables: Path) -> None:
    """The first parser stores them, the next one reads them; broken ones are made again."""
    first = [chain.nodes for chain in parse(TEXT, {})]
    written = stored_tables.read_bytes()
    for found in (written, written[: len(written) // 2], b""):
        stored_tables.write_bytes(found)
        parse_module._parser.cache_clear()
        assert [chain.nodes for chain in parse(TEXT, {})] == first
        # The order of sets in them differs from one making to the next.
        assert stored_tables.stat().st_size == pytest.approx(len(written), rel=0.01)


def test_no_tables_are_stored_where_no_bytecode_is(
    stored_tables: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with PYTHONDONTWRITEBYTECODE."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert parse(TEXT, {})
    assert not stored_tables.exists()


def test_tables_that_cannot_be_stored_are_made(
    stored_tables: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """An installation may be read-only; nothing is said about it."""
    stored_tables.parent.rmdir()
    assert parse(TEXT, {})
    assert capfd.readouterr() == ("", "")


def test_a_new_chain_begins_where_the_last_cannot_go_on() -> None:
    """No separator is needed."""
    assert [len(chain.nodes) for chain in parse("a ! b c t. ! d ! e. f", {})] == [2, 1, 3, 1]


def test_pads_references_addresses_and_bins() -> None:
    """All kinds of nodes, with the pads written on either side."""
    chain = parse("a .s1,s2 ! .k1 b", {})[0]
    first, second = chain.nodes
    assert isinstance(first, ElementNode)
    assert isinstance(second, ElementNode)
    assert (first.src_pads, second.sink_pads) == (("s1", "s2"), ("k1",))
    reference = parse("t.src_1,src_2 ! a", {})[0].nodes[0]
    assert isinstance(reference, ReferenceNode)
    assert (reference.name, reference.pads) == ("t", ("src_1", "src_2"))
    address = parse("file:///x ! a", {})[0].nodes[0]
    assert isinstance(address, UrlNode)
    group = parse("pipeline.( name=p a ! b c )", {})[0].nodes[0]
    assert isinstance(group, BinNode)
    assert (group.factory, len(group.chains), group.assignments[0].value) == ("pipeline", 2, "p")


@pytest.mark.parametrize(
    ("text", "pointed"),
    [
        (
            "fakesrc !",
            "description:1:9: the description ends where an element must follow\n"
            "    fakesrc !\n"
            "            ^",
        ),
        (
            "fakesrc ! ! fakesink",
            "description:1:11: unexpected '!'; expected an element\n"
            "    fakesrc ! ! fakesink\n"
            "              ^",
        ),
        (
            "fakesrc\n  ! identity\n  ; fakesink",
            "description:3:3: unexpected ';'; expected '!', a property, an element, the end\n"
            "      ; fakesink\n"
            "      ^",
        ),
        (
            "num-buffers=3 fakesrc",
            "description:1:1: unexpected 'num-buffers='; expected an element, the end; "
            "a property must follow its element\n"
            "    num-buffers=3 fakesrc\n"
            "    ^^^^^^^^^^^^^",
        ),
        (
            "fakesrc ! ( queue",
            "description:1:17: the description ends where ')', an element must follow\n"
            "    fakesrc ! ( queue\n"
            "                    ^",
        ),
        (
            "fakesrc ! 'video/x-raw, width=4' ! fakesink",
            "description:1:11: unexpected \"'\"; expected an element; "
            "write a caps filter without quotes, which only a shell needs\n"
            "    fakesrc ! 'video/x-raw, width=4' ! fakesink\n"
            "              ^",
        ),
        (
            "fakesrc ! \\\n fakesink",
            "description:1:11: unexpected '\\\\'; expected an element; "
            "lines are joined without it; only a shell needs it\n"
            "    fakesrc ! \\\n"
            "              ^",
        ),
        (
            "fakesrc ! fakesink # no file",
            "description:1:20: unexpected '#'; expected '!', a property, an element, the end; "
            "comments stand in texts of several lines, as in a file (-f FILE)\n"
            "    fakesrc ! fakesink # no file\n"
            "                       ^",
        ),
        (
            "fakesrc ! kü",
            "description:1:12: unexpected 'ü'; expected '!', a property, an element, the end; "
            "names are ASCII; put other characters into quoted values\n"
            "    fakesrc ! kü\n"
            "               ^",
        ),
        (
            "fakesrc .src ,",
            "description:1:14: the description ends where an element must follow\n"
            "    fakesrc .src ,\n"
            "                 ^",
        ),
        (
            "( fakesrc location=x)",
            "description:1:21: the description ends where ')', an element must follow; "
            "the ')' is part of the value of location: put a blank before it\n"
            "    ( fakesrc location=x)\n"
            "                        ^",
        ),
        (
            " \n ",
            "description:1:1: the description is empty: write at least one element\n"
            "     \n"
            "    ^",
        ),
    ],
)  # fmt: skip
def test_an_error_points_into_the_text(text: str, pointed: str) -> None:
    """Place, rule, what stands there, what may stand there; the line with carets below the fault."""
    with pytest.raises(DescriptionError) as caught:
        parsed(text)
    assert caught.value.pointed(text) == pointed
    assert caught.value.code == ("empty" if not text.strip() else "syntax")


def test_a_long_line_is_shown_around_the_fault() -> None:
    """At most 120 characters, and the caret stands right."""
    text = "queue ! " * 100 + "; " + "queue ! " * 100
    with pytest.raises(DescriptionError) as caught:
        parsed(text)
    _, shown, carets = caught.value.pointed(text, "x.pipe").split("\n")
    assert len(shown) <= 124
    assert shown[carets.index("^")] == ";"


def test_control_characters_are_not_printed() -> None:
    """They become blanks."""
    text = "queue\x1b[2J\x0b\u2028 ;\n! x"
    with pytest.raises(DescriptionError) as caught:
        parsed(text)
    assert caught.value.pointed(text).split("\n")[1] == "    queue [2J   ;"


def test_carets_of_a_long_token_are_truncated() -> None:
    """As the text is."""
    text = "queue name=q " + "x" * 5000 + "=1=2 ;"
    with pytest.raises(DescriptionError) as caught:
        parsed(text)
    assert max(map(len, caught.value.pointed(text).split("\n"))) < 250


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ('"a b"', "a b"),
        (r"a\ b", "a b"),
        (r'"say \"hi\""', 'say "hi"'),
        (r'"C:\dir"', "C:dir"),
        (r'"C:\\dir"', r"C:\dir"),
        (r'"a\nb"', "anb"),
        ('"a"b', '"a"b'),
        ("'a b'", "'a b'"),
        ('""', ""),
        ('"', ""),
        (r"a\"b\"c", 'a"b"c'),
        (r'a/b,s="x\"\,y",t=\ z', r'a/b,s="x\"\,y",t= z'),
        ("x\\", "x"),
        (r'a/b,s=(string)"x\,x"', r'a/b,s=(string)"x\,x"'),
    ],
)
def test_unquoting_is_gst_launchs(text: str, value: str) -> None:
    """One pair of quotes off, backslashes resolved, except between inner quotes."""
    assert unquote_value(text) == value


def test_nodes_before_a_syntax_error_are_kept() -> None:
    """They may have an earlier error."""
    chains = parse("a ! b x=1 c ! ( d .p , ;", {})
    assert [len(chain.nodes) for chain in chains] == [2, 2]
    group = chains[1].nodes[1]
    assert isinstance(group, BinNode)
    assert [type(chain.nodes[0]) for chain in group.chains] == [ElementNode, FaultNode]


words = st.sampled_from(
    ["fakesrc", "queue", "t.", "t.src_1", ".sink", "!", ":", "(", ")", "bin.(", "a=1", 'a="x y"', ",", ";",
     "a/b", "! a/b, x={1,2} !", "file:///x", "@preset=p", "name=t", "#", "\n", "${X:-queue}", "ü", '"', "\\"]
)  # fmt: skip


def outcome(text: str) -> tuple[tuple[ChainNode, ...], str, Place]:
    """The chains of a text, or its error as it is shown, and where."""
    try:
        return parsed(text), "", Place()
    except DescriptionError as error:
        return (), error.pointed(text), error.place


@given(st.text(max_size=100) | st.lists(words, max_size=25).map(" ".join))
@settings(max_examples=300)
def test_any_text_is_a_description_or_a_description_error(text: str) -> None:
    """No text makes parsing raise anything else, and its error can be shown."""
    chains, pointed, place = outcome(text)
    assert all(len(chain.links) == len(chain.nodes) - 1 for chain in chains)
    assert pointed.startswith(f"description:{place.line}:{place.column}: ") or (chains and not pointed)


@pytest.mark.parametrize(
    "text",
    [
        "(" * 20_000,
        "( " * 5_000 + "queue" + " )" * 5_000,
        "queue ! " * 3_000 + "queue",
        "a" * 500_000,
        "queue\n" * 3_000,
        "a ! " + ";".join(["aa/aa"] * 40),
        ("aaaa" * 1000 + " ${X:-}") * 30,
        "a=" + "${X:-y}" * 3_000,
    ],
)
def test_large_and_deep_texts_end_in_bounded_time(text: str) -> None:
    """Size and nesting are no way to stop the program."""
    begun = time.process_time()
    chains, pointed, _ = outcome(text)
    assert time.process_time() - begun < 10.0
    assert bool(chains) is not bool(pointed)
    assert len(pointed) < 1000
