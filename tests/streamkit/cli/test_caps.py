"""`streamkit caps`: computes with caps, prints JSON, reports the place of errors."""

import json
import os
import pty
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from streamkit.cli.caps import as_text
from streamkit.cli.main import make_app

RUNNER = CliRunner()


def caps(*arguments: str) -> Result:
    """Runs the command in this process."""
    return RUNNER.invoke(make_app(), ["caps", *arguments])


def result(*arguments: str) -> dict[str, Any]:
    """What the command prints."""
    done = caps(*arguments)
    assert done.exit_code == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def error(*arguments: str) -> dict[str, Any]:
    """What the command prints on stderr."""
    done = caps(*arguments)
    assert done.exit_code == 2
    assert done.stdout == ""
    found: dict[str, Any] = json.loads(done.stderr)["error"]
    assert list(found) == ["code", "message", "line", "column", "length", "hint"]
    return found


def test_caps_are_printed_as_one_object() -> None:
    """The text, the kind of caps, and every field with its type."""
    assert result("parse", "video/x-raw(memory:A), width=[1,10], rate=30000/1001, f={ 1, x }; a/b") == {
        "caps": "video/x-raw(memory:A), width=(int)[ 1, 10 ], rate=(fraction)30000/1001, "
        "f={ (int)1, (string)x }; a/b",
        "any": False,
        "empty": False,
        "size": 2,
        "fixed": False,
        "structures": [
            {
                "name": "video/x-raw",
                "features": ["memory:A"],
                "fields": {
                    "width": {"type": "int", "value": {"range": [1, 10]}},
                    "rate": {"type": "fraction", "value": "30000/1001"},
                    "f": {
                        "type": "int",
                        "value": {"list": [{"type": "int", "value": 1}, {"type": "string", "value": "x"}]},
                    },
                },
            },
            {"name": "a/b", "features": [], "fields": {}},
        ],
    }


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("(uint)0xFF000000", {"type": "uint", "value": 4278190080}),
        ("(int64)[ 0, 16, 4 ]", {"type": "gint64", "value": {"range": [0, 16, 4]}}),
        ("[ 0.5, 1.5 ]", {"type": "double", "value": {"range": [0.5, 1.5]}}),
        ("(fraction)[ 0, max ]", {"type": "fraction", "value": {"range": ["0/1", "2147483647/1"]}}),
        ("f:3", {"type": "flagset", "value": {"flags": 3, "mask": 3}}),
        ("< yes >", {"type": "boolean", "value": {"array": [{"type": "boolean", "value": True}]}}),
        ("(buffer)AA", {"type": "buffer", "value": "aa"}),
        ("(date)2020-1-2", {"type": "date", "value": "2020-01-02"}),
        ("NULL", {"type": "string", "value": None}),
        (
            "[s, x=1]",
            {
                "type": "structure",
                "value": {"name": "s", "features": [], "fields": {"x": {"type": "int", "value": 1}}},
            },
        ),
    ],
)
def test_every_type_has_a_json_value(text: str, field: dict[str, Any]) -> None:
    """Numbers as numbers, fractions as text so that they stay exact, choices as objects."""
    assert result("parse", f"a/b, f={text}")["structures"][0]["fields"]["f"] == field


def test_nested_caps_have_the_shape_of_caps() -> None:
    """Caps inside a field are printed like top-level caps."""
    field = result("parse", "a/b, f=(GstCaps)[s; t]")["structures"][0]["fields"]["f"]
    assert field == {"type": "GstCaps", "value": result("parse", "s; t")}


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("intersect", "f/A; f/B; f/C", "f/C; f/A; f/B"), "f/A; f/C; f/B"),
        (("intersect", "--mode", "first", "f/A; f/B; f/C", "f/C; f/A; f/B"), "f/A; f/B; f/C"),
        (("intersect", "a/b, f={ 1, 2, 3 }", "a/b, f={ 2, 3 }", "a/b, f=3"), "a/b, f=(int)3"),
        (("intersect", "a/b, f=1", "a/b, f=2"), "EMPTY"),
        (("union", "a/b, f=1", "a/b, f=1", "c/d"), "a/b, f=(int)1; c/d"),
        (("merge", "ANY", "c/d"), "ANY"),
        (("fixate", "a/b, f=[ 3, 9 ], g={ x, y }; c/d"), "a/b, f=(int)3, g=(string)x"),
        (("normalize", "a/b, f={ 1, 2 }"), "a/b, f=(int)1; a/b, f=(int)2"),
        (("normalise", "a/b, f={ 1, 2 }"), "a/b, f=(int)1; a/b, f=(int)2"),
        (("simplify", "a/b, f=1; a/b, f=2"), "a/b, f=(int){ 1, 2 }"),
        (("truncate", "a/b; c/d"), "a/b"),
        (("parse", "NONE"), "EMPTY"),
    ],
)
def test_operations_on_caps(arguments: tuple[str, ...], text: str) -> None:
    """The text is GStreamer's; an intersection is in its zig-zag order unless asked otherwise."""
    assert result(*arguments)["caps"] == text


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        (("subset", "a/b, f=1", "a/b"), True),
        (("subset", "a/b", "a/b, f=1"), False),
        (("equal", "a/b; c/d", "c/d; a/b"), True),
        (("strictly-equal", "a/b; c/d", "c/d; a/b"), False),
        (("can_intersect", "a/b, f=1", "a/b, g=1"), True),
        (("is-fixed", "a/b, f=1"), True),
        (("is-fixed", "ANY"), False),
        (("value-subset", "1", "{ 1, 2 }"), True),
        (("value-equal", "{ 1, 2 }", "{ 2, 1 }"), True),
    ],
)
def test_boolean_operations(arguments: tuple[str, ...], answer: bool) -> None:
    """The result is `{"result": true}` or `{"result": false}`."""
    assert result(*arguments) == {"result": answer}


def test_relation_of_two_caps() -> None:
    """`relate` prints all comparisons of two caps."""
    assert result("relate", "a/b, f=1", "a/b") == {
        "equal": False, "strictly_equal": False, "subset": True, "superset": False, "can_intersect": True,
    }  # fmt: skip


def test_value_operations() -> None:
    """Single values are parsed as in a field; an empty intersection is null."""
    assert result("value-intersect", "[16, 4096, 16]", "[100, 200, 10]")["result"] == "160"
    assert result("value-union", "[16, 32, 16]", "[48, 96, 16]")["result"] == "[ 16, 96, 16 ]"
    assert result("value-union", "[16, 32, 16]", "[64, 96, 16]") == {"result": None}
    assert result("value", "{ test, }")["value"]["list"] == [{"type": "string", "value": "test"}]
    assert result("deserialize", "guint64", "-1")["value"] == 2**64 - 1
    assert result("deserialize", "gint", "-123456") == {"result": "-123456", "type": "int", "value": -123456}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("parse", "a/b,\n  f=(it)3"), ("syntax", 2, 6, 2, 'did you mean "int"?')),
        (("intersect", "a/b", "a/b, f=[ 9, 1 ]"), ("syntax", 1, 8, 8, "")),
        (("parse", ""), ("syntax", 1, 1, 1, "")),
        (("deserialize", "gint", "4294967296"), ("syntax", 1, 1, 10, "")),
        (("fixate", "ANY"), ("syntax", 1, 1, 3, "give caps with a name")),
        (("subset", "a/b"), ("usage", 1, 1, 1, "")),
        (("intersect", "--mode", "second", "a/b", "a/b"), ("usage", 1, 1, 1, "")),
    ],
)
def test_errors_point_into_the_text(
    arguments: tuple[str, ...], expected: tuple[str, int, int, int, str]
) -> None:
    """Line, column and length are those of the error; the exit code is 2."""
    found = error(*arguments)
    assert tuple(found[name] for name in ("code", "line", "column", "length", "hint")) == expected


def test_too_large_results_are_errors() -> None:
    """A result with too many structures is an error instead of filling memory."""
    text = "a/b" + "".join(f", f{index}={{ 1, 2, 3 }}" for index in range(40))
    assert error("normalize", text)["code"] == "too-large"


def test_an_unknown_operation_lists_all_operations() -> None:
    """The hint names all operations."""
    found = error("frobnicate", "a/b")
    assert found["code"] == "usage"
    assert "parse, intersect, union, subset, equal" in found["hint"]


def test_text_that_is_no_utf8_is_refused() -> None:
    """An undecodable byte from the shell is a syntax error, not a crash."""
    assert error("parse", 'a/b, f="\udcff"')["code"] == "syntax"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("parse", "a/b; c/d, x=1"), "a/b;\nc/d, x=(int)1"),
        (("subset", "a/b", "a/b"), "yes"),
        (("value-intersect", "[ 1, 5 ]", "[ 6, 9 ]"), "nothing"),
        (("value-intersect", "[ 1, 5 ]", "[ 3, 9 ]"), "[ 3, 5 ]"),
        (
            ("relate", "a/b", "c/d"),
            "equal: no\nstrictly equal: no\nsubset: no\nsuperset: no\ncan intersect: no",
        ),
    ],
)
def test_results_are_text_on_a_terminal(arguments: tuple[str, ...], text: str) -> None:
    """One line for each structure or answer."""
    assert as_text(json.loads(CliRunner().invoke(make_app(), ["caps", *arguments, "--json"]).stdout)) == text


def test_errors_are_text_on_a_terminal() -> None:
    """With a mark below the fault; --json prints the object there, too."""
    command = [str(Path(sys.executable).with_name("streamkit")), "caps", "parse", "a/b, width="]
    printed = []
    for options in ((), ("--json",)):
        master, slave = pty.openpty()
        done = subprocess.run([*command, *options], stderr=slave, timeout=60, check=False)
        os.close(slave)
        printed.append(os.read(master, 10_000).decode().replace("\r", ""))
        os.close(master)
        assert done.returncode == 2
    mark = " " * (4 + len("a/b, width="))
    assert printed[0] == f"caps:1:12: expected a value, got 'the end'\n    a/b, width=\n{mark}^\n"
    assert json.loads(printed[1])["error"]["column"] == 12
