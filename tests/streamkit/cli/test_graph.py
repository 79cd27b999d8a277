"""`streamkit graph`: builds a pipeline without running it and draws it."""

import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner, Result

from streamkit import Element, Property, Sink, Source, Transform
from streamkit.cli.graph import Counters, as_text
from streamkit.cli.main import make_app
from streamkit.graph.build import build

Register = Callable[..., None]
SVG = "{http://www.w3.org/2000/svg}"


def graph(*arguments: str) -> Result:
    """Runs the command in this process."""
    return CliRunner().invoke(make_app(), ["graph", *arguments])


def as_json(text: str) -> dict[str, Any]:
    """The graph as JSON."""
    done = graph("--format", "json", text)
    assert done.exit_code == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_json_format() -> None:
    """Elements with the properties set in the text, links with their caps, warnings."""
    assert as_json("fakesrc num-buffers=3 ! a/b,x=1 ! ( name=b identity ) ! fakesink name=end") == {
        "elements": [
            {"name": "fakesrc0", "factory": "fakesrc", "parent": None, "properties": {"num-buffers": 3}},
            {"name": "identity0", "factory": "identity", "parent": "b", "properties": {}},
            {"name": "end", "factory": "fakesink", "parent": None, "properties": {}},
            {"name": "capsfilter0", "factory": "capsfilter", "parent": None,
             "properties": {"caps": "a/b, x=(int)1"}},
            {"name": "b", "factory": "bin", "parent": None, "properties": {},
             "ghost_pads": {"ghost0": "identity0.sink", "ghost1": "identity0.src"}},
        ],
        "inserted": [],
        "links": [
            {"src": "fakesrc0.src", "sink": "capsfilter0.sink", "caps": "a/b, x=(int)1"},
            {"src": "identity0.src", "sink": "end.sink", "caps": "a/b, x=(int)1"},
            {"src": "capsfilter0.src", "sink": "identity0.sink", "caps": "a/b, x=(int)1"},
        ],
        "warnings": [],
    }  # fmt: skip


class Camera(Source):
    """Colour."""

    src = "video/x-raw, format=BGR"


class Screen(Sink):
    """Grey."""

    sink = "video/x-raw, format=GRAY8"


class Convert(Transform):
    """Any."""

    sink = "video/x-raw, format={ BGR, GRAY8 }"
    src = "video/x-raw, format={ GRAY8, BGR }"


def test_inserted_converters_are_listed_apart(register: Register) -> None:
    """They are under `inserted`, with a warning, and not among the elements of the text."""
    register(camera=Camera, screen=Screen, videoconvert=Convert)
    found = as_json("camera ! screen")
    assert [item["name"] for item in found["elements"]] == ["camera0", "screen0"]
    assert [item["name"] for item in found["inserted"]] == ["videoconvert0"]
    assert [warning["code"] for warning in found["warnings"]] == ["converter-inserted"]


class Guarded(Element):
    """A secret and odd texts."""

    sink = "ANY"
    password: str = Property("", secret=True)
    text: str = Property("")


def test_equal_names_in_different_bins_are_distinguished() -> None:
    """Two elements with the same name are two nodes in the drawing."""
    text = "( fakesrc name=a ! fakesink name=b ) ( fakesrc name=a ! fakesink name=b )"
    dot = graph("--format", "dot", text).stdout
    assert '"a" -> "b" [' in dot
    assert '"a (2)" -> "b (2)" [' in dot
    mermaid = graph("--format", "mermaid", text).stdout
    assert [line.split()[0] for line in mermaid.splitlines() if '["a"]' in line] == ['n0["a"]', 'n2["a"]']


@pytest.mark.parametrize("form", ["json", "dot", "mermaid"])
def test_passwords_in_addresses_are_masked_in_every_format(register: Register, form: str) -> None:
    """User and password of a URI are masked in any property."""
    register(guarded=Guarded)
    done = graph("--format", form, "fakesrc ! guarded text=rtsp://me:hunter2@cam/live")
    assert done.exit_code == 0
    assert "hunter2" not in done.stdout
    assert "rtsp://***@cam/live" in done.stdout


@pytest.mark.parametrize(
    "text",
    [
        "fakesrc ! guarded password=hunter2 ! nosuch",
        "nosuch ! guarded password=hunter2",
        "fakesrc password=hunter2",
        "password=hunter2 fakesrc",
        "fakesrc ! guarded token=hunter2",
        "fakesrc ! rtsp://me:hunter2@cam/live x",
        "fakesrc num-buffers=rtsp://me:hunter2@cam/live",
        'fakesrc ! guarded password="hunter2 x',
        "fakesrc ! guarded text=rtsp://me:hunter2@cam/live !",
        "( fakesrc ! guarded password=hunter2)",
    ],
)
@pytest.mark.parametrize("form", ["json", "mermaid"])
def test_secrets_are_masked_in_errors(register: Register, text: str, form: str) -> None:
    """Neither the message nor the quoted line shows them."""
    register(guarded=Guarded)
    done = graph("--format", form, text)
    assert done.exit_code == 2
    assert "hunter2" not in done.stderr


@pytest.mark.parametrize("form", ["json", "dot", "mermaid"])
def test_secrets_are_masked_in_every_format(register: Register, form: str) -> None:
    """Drawings can be shared."""
    register(guarded=Guarded)
    done = graph("--format", form, "fakesrc ! guarded password=hunter2")
    assert done.exit_code == 0
    assert "hunter2" not in done.stdout
    assert "***" in done.stdout


def test_dot_and_mermaid_show_elements_links_and_caps() -> None:
    """Names, settings and the caps on each link."""
    text = "fakesrc num-buffers=3 ! a/b,x=1 ! fakesink"
    dot = graph("--format", "dot", text).stdout
    assert dot.startswith("digraph pipeline {")
    assert '"fakesrc0" [label="fakesrc0\\nnum-buffers=3"];' in dot
    assert '"fakesrc0" -> "capsfilter0" [label="a/b, x=(int)1"];' in dot
    mermaid = graph(text).stdout
    assert mermaid.splitlines()[:2] == ["flowchart LR", '  n0["fakesrc0<br>num-buffers=3"]']
    assert '  n0 -- "a/b, x=(int)1" --> n2' in mermaid.splitlines()


def test_quotes_and_backslashes_are_escaped(register: Register) -> None:
    """They stay inside their label."""
    register(guarded=Guarded)
    text = r'fakesrc ! guarded text="a \"quoted\" \\ text"'
    dot = graph("--format", "dot", text).stdout
    assert r'"guarded0" [label="guarded0\ntext=a \"quoted\" \\ text"];' in dot
    assert '  n1["guarded0<br>text=a #quot;quoted#quot; \\ text"]' in graph(text).stdout.splitlines()


def test_svg_shows_elements_links_and_caps(monkeypatch: pytest.MonkeyPatch, register: Register) -> None:
    """One text for each line, in a document that needs no other program; special characters are escaped."""
    monkeypatch.setenv("PATH", "")
    register(guarded=Guarded)
    done = graph("--format", "svg", 'fakesrc ! a/b,x=1 ! guarded name=g text="<x&y>" password=p')
    texts = [element.text for element in ElementTree.fromstring(done.stdout).iter(f"{SVG}text")]
    assert texts.count("a/b, x=(int)1") == 2
    assert {"fakesrc0", "capsfilter0", "g (guarded)", "text=<x&y>", "password=***"} <= set(texts)


@pytest.mark.parametrize("form", ["json", "mermaid"])
def test_a_long_chain_is_drawn_in_linear_time(form: str) -> None:
    """x-q37: 500 elements in a row."""
    done = graph("--format", form, " ! ".join(["fakesrc", *["identity"] * 500, "fakesink"]))
    assert done.exit_code == 0
    assert "identity499" in done.stdout


def test_a_bad_description_is_code_2() -> None:
    """As JSON where JSON was asked for, else with a caret."""
    done = graph("--format", "json", "fakesrc !")
    assert done.exit_code == 2
    assert json.loads(done.stderr)["error"]["code"] == "syntax"
    done = graph("fakesrc !")
    assert (done.exit_code, done.stderr.splitlines()[-1]) == (2, "            ^")


def test_an_unused_variable_is_reported() -> None:
    """A note on stderr names it and the variables of the description."""
    done = graph("--format", "json", "--set", "cuont=7", "fakesrc num-buffers=${count:-2} ! fakesink")
    assert json.loads(done.stdout)["elements"][0]["properties"] == {"num-buffers": 2}
    assert done.stderr == "note: --set cuont is not used: the description has no ${cuont}; it has count\n"


def test_text_for_a_terminal() -> None:
    """Each element with its settings and links; a name that does not tell the type is followed by it."""
    assert graph("--format", "text", "fakesrc num-buffers=3 ! a/b,x=1 ! fakesink name=end").stdout == (
        "fakesrc0  num-buffers=3\n"
        "  src -> capsfilter0.sink  a/b, x=(int)1\n"
        "end (fakesink)\n"
        "capsfilter0  caps=a/b, x=(int)1\n"
        "  src -> end.sink  a/b, x=(int)1\n"
    )


def test_caps_fit_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are shortened at a space to the width of a terminal, a file has all of them."""
    media = "; ".join(f"video/x-kind{number}" for number in range(20))
    built = build(f"fakesrc ! {media} ! fakesink", {})
    assert max(map(len, as_text(built, Counters()).splitlines())) > 300
    monkeypatch.setattr("sys.stdout", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setenv("COLUMNS", "80")
    links = [line for line in as_text(built, Counters()).splitlines() if "->" in line]
    assert links[0] == "  src -> capsfilter0.sink  video/x-kind0; video/x-kind1; video/x-kind2; ..."
