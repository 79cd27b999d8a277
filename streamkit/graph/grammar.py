"""Parser of the description language, loaded from generated tables or built from the grammar.

Building takes lark 0.1 s. After a change of grammar.lark, `python -m streamkit.graph.grammar` updates the
tables.
"""

from __future__ import annotations

import functools
import hashlib
from importlib.resources import files
from pathlib import Path

import lark
from lark import Lark

from streamkit.graph.tokens import DescriptionLexer


def grammar_text() -> str:
    """Text of grammar.lark."""
    return (files("streamkit.graph") / "grammar.lark").read_text(encoding="utf-8")


def build_parser() -> Lark:
    """Builds the parser from the grammar."""
    return Lark(grammar_text(), parser="lalr", lexer=DescriptionLexer, maybe_placeholders=False)


@functools.cache
def parser() -> Lark:
    """The parser, from the tables if the installed lark made them."""
    from streamkit.graph import grammar_tables

    if lark.__version__ != grammar_tables.LARK_VERSION:
        return build_parser()
    data = {**grammar_tables.DATA}
    data["options"] = {**data["options"], "lexer": DescriptionLexer}
    frontend = data["parser"]
    data["parser"] = {**frontend, "lexer_conf": {**frontend["lexer_conf"], "lexer_type": DescriptionLexer}}
    return Lark.load({"data": data, "memo": grammar_tables.MEMO})


def tables_source() -> str:
    """Source of grammar_tables.py for the current grammar."""
    from lark.grammar import Rule
    from lark.lexer import TerminalDef

    data, memo = build_parser().memo_serialize([TerminalDef, Rule])
    data["options"]["lexer"] = data["parser"]["lexer_conf"]["lexer_type"] = None
    digest = hashlib.sha256(grammar_text().encode()).hexdigest()
    return (
        '"""Tables of the parser, written by `python -m streamkit.graph.grammar`; not to be edited."""\n\n'
        "from typing import Any\n\n"
        f'GRAMMAR_SHA256 = "{digest}"\nLARK_VERSION = "{lark.__version__}"\n'
        f"DATA: dict[str, Any] = {data!r}\nMEMO: dict[int, Any] = {memo!r}\n"
    )


if __name__ == "__main__":
    Path(__file__).with_name("grammar_tables.py").write_text(tables_source(), encoding="utf-8")
