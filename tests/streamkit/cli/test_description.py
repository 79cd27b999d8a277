"""Descriptions of commands: arguments, files, variables, and their errors."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from streamkit.cli.description import join_arguments
from streamkit.cli.main import make_app


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["fakesrc ! fakesink"], "fakesrc ! fakesink"),
        (["fakesrc", "!", "fakesink"], "fakesrc ! fakesink"),
        (["filesrc", "location=a b"], r"filesrc location=a\ b"),
        (["filesrc", 'location="a b"'], 'filesrc location="a b"'),
        (["filesrc", r'location="a \" b" c d'], r'filesrc location="a \" b"\ c\ d'),
        (["a", "b\tc"], "a b\tc"),
        (["fakesrc", "!", "a/b, x=1", "!", "fakesink"], r"fakesrc ! a/b,\ x=1 ! fakesink"),
    ],
)
def test_arguments_are_joined_as_gst_launch_does(arguments: list[str], text: str) -> None:
    """g10-g17: one is the text; of several the blanks outside double quotes are escaped."""
    assert join_arguments(arguments) == text


def graph(*arguments: str, stdin: str | bytes | None = None) -> tuple[int, str, str]:
    """Exit code and what was printed."""
    done = CliRunner().invoke(make_app(), ["graph", "--format", "json", *arguments], input=stdin)
    return done.exit_code, done.stdout, done.stderr


def test_a_bad_description_is_an_error_object() -> None:
    """On stderr, alone, with exit code 2: code, message, place and hint."""
    code, out, error = graph("fakesrc\n ! queu ! fakesink")
    assert (code, out) == (2, "")
    assert json.loads(error) == {
        "error": {
            "code": "no-such-element", "message": 'no element "queu"', "line": 2, "column": 4, "length": 4,
            "hint": 'did you mean "queue"?',
        }
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "empty"),
        (" \n", "empty"),
        ("fakesrc !", "syntax"),
        ("nosuch", "no-such-element"),
        ("fakesrc nosuch=1", "no-such-property"),
        ("fakesrc num-buffers=x", "could-not-set-property"),
        ("fakesink ! fakesrc", "link"),
        ("( )", "empty-bin"),
    ],
)
def test_every_error_code(text: str, code: str) -> None:
    """Each code of the contract can be produced."""
    exit_code, _, error = graph(text)
    assert (exit_code, json.loads(error)["error"]["code"]) == (2, code)


def test_a_file_has_comments_line_breaks_and_variables(tmp_path: Path) -> None:
    """Places in errors are those of the file."""
    file = tmp_path / "a.pipe"
    file.write_text("# what it does\nfakesrc num-buffers=${N:-2}  # few\n  ! ${SINK}\n", encoding="utf-8")
    code, out, _ = graph("-f", str(file), "--set", "SINK=fakesink")
    assert code == 0
    assert [item["properties"] for item in json.loads(out)["elements"]] == [{"num-buffers": 2}, {}]
    code, _, error = graph("-f", str(file), "--set", "SINK=fakesunk")
    assert code == 2
    found = json.loads(error)["error"]
    assert (found["line"], found["column"], found["length"]) == (3, 5, 7)


def test_a_description_comes_from_standard_input() -> None:
    """As -f -, in the form of a file and within its limits."""
    code, out, _ = graph("-f", "-", "--set", "N=2", stdin="# few\r\nfakesrc num-buffers=${N}\r\n ! fakesink")
    assert code == 0
    assert json.loads(out)["elements"][0]["properties"] == {"num-buffers": 2}
    wanted = "error: standard input: a description has at most 1000000 bytes\n"
    assert graph("-f", "-", stdin=1_000_001 * "#") == (2, "", wanted)
    wanted = "error: cannot read the description -: it is no UTF-8 text\n"
    assert graph("-f", "-", stdin=b"\xff") == (2, "", wanted)
    done = CliRunner().invoke(make_app(), ["launch", "--supervise", "-f", "-"], input="fakesrc ! fakesink")
    assert (done.exit_code, "give a file in place of -f -" in done.stderr) == (2, True)


def test_a_byte_order_mark_is_no_part_of_a_description() -> None:
    """As Windows' editors write it."""
    code, _, error = graph("-f", "-", stdin="fakesrc ! fakesink".encode("utf-8-sig"))
    assert (code, error) == (0, "")


def test_a_file_without_its_option_is_told() -> None:
    """The name would be read as that of an element."""
    wanted = "error: my/track.pipe is a file of a description, give it with -f my/track.pipe\n"
    assert graph("my/track.pipe") == (2, "", wanted)
