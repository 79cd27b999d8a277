"""`streamkit inspect`: lists elements and describes one."""

import contextlib
import json
import os
import pty
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from streamkit import Frame, Property, Transform
from streamkit.cli.main import make_app
from streamkit.element.registry import available_elements

Register = Callable[..., None]


def inspect(*arguments: str) -> Result:
    """Runs the command in this process."""
    return CliRunner().invoke(make_app(), ["inspect", *arguments])


def facts(name: str) -> dict[str, Any]:
    """The JSON description of an element."""
    found: dict[str, Any] = json.loads(inspect(name, "--json").stdout)
    return found


class Gain(Transform):
    """Multiplies the brightness.

    Of every pixel.

    Attributes:
        number: for programs, not for descriptions.

            In two paragraphs.

    Example:
        fakesrc num-buffers=5
            ! gain factor=2 ! fakesink

    Source: none.
    """

    sink = "video/x-raw, format={ GRAY8, BGR }; video/x-foo"
    src = "ANY"
    factor: float = Property(1.5, min=0.0, unit="x", live=True, doc="How much.")
    key: str = Property("k", secret=True, doc="Never shown.")

    def transform(self, frame: Frame) -> Frame:
        return frame


def test_the_list_says_what_each_element_does(register: Register) -> None:
    """One line per element, sorted; the package of others' elements is named."""
    register(gain=Gain)
    lines = inspect().stdout.splitlines()
    rows = dict(line.split(maxsplit=1) for line in lines)
    assert list(rows) == sorted(rows)
    assert rows["queue"] == "Runs downstream in its own thread; holds frames up to three limits."
    assert "unknown package" in rows.pop("gain")
    assert all(text.endswith(".") for text in rows.values())


@pytest.mark.parametrize("name", sorted(available_elements()))
def test_the_example_can_be_pasted(name: str) -> None:
    """A shell gives launch the description as one argument, quotes and all."""
    found = facts(name)
    line = inspect(name).stdout.partition("\nExample\n")[2].strip()
    assert shlex.split(line) == ["streamkit", "launch", " ".join(found["example"].split())]


def test_properties_of_the_base_class_are_folded() -> None:
    """A sink's own come first; the others follow by name, or in full with --all."""
    short, whole = inspect("fakesink").stdout, inspect("fakesink", "--all").stdout
    assert short.index("  num-buffers  (") < short.index("(see --all): sync,")
    assert "Render each frame at its running time." not in short
    assert "Render each frame at its running time." in whole


def test_the_list_as_json() -> None:
    """The same values as JSON."""
    rows = {row["name"]: row for row in json.loads(inspect("--json").stdout)}
    assert rows["tee"] == {
        "name": "tee", "package": "streamkit", "version": "0.1.0", "class": "streamkit.elements.tee:Tee",
    }  # fmt: skip


def test_text_of_an_element(register: Register) -> None:
    """Doc, pads with caps, properties with range, unit and default, and an example."""
    register(gain=Gain)
    assert inspect("gain").stdout == (
        "gain - Multiplies the brightness.\n\nOf every pixel.\n\n"
        "  Transform of unknown package  (elements_of_a_test:gain)\n\n"
        "Pads\n"
        "  sink  sink, always\n"
        "      video/x-raw, format=(string){ GRAY8, BGR }\n"
        "      video/x-foo\n"
        "  src  src, always\n"
        "      ANY\n\n"
        "Properties\n"
        "  factor  (float 0.0.. x; default 1.5, may change while playing)\n"
        "      How much.\n"
        '  key  (str; default "***")\n'
        "      Never shown.\n\n"
        "Example\n"
        '  streamkit launch "fakesrc num-buffers=5 ! gain factor=2 ! fakesink"\n'
    )


def test_an_element_without_a_docstring_has_no_other(register: Register) -> None:
    """Its base class's is for authors, and not of this element."""
    register(plain=type("Plain", (Gain,), {}))
    assert inspect("plain").stdout.startswith("plain\n\n  Transform of ")


def test_an_element_as_json() -> None:
    """The same values as JSON."""
    found = facts("queue")
    assert (found["name"], found["kind"], found["package"]) == ("queue", "Element", "streamkit")
    assert [pad["name"] for pad in found["pads"]] == ["sink", "src"]
    leaky = next(item for item in found["properties"] if item["name"] == "leaky")
    assert leaky == {
        "name": "leaky", "type": "Leaky", "values": "no | upstream | downstream", "default": "no",
        "minimum": None, "maximum": None, "unit": "", "choices": ["no", "upstream", "downstream"],
        "live": True, "readonly": False,
        "doc": "Which frame a full queue drops instead of waiting.",
    }  # fmt: skip


def test_an_unknown_element_is_code_2() -> None:
    """With a suggestion."""
    done = inspect("queu")
    assert (done.exit_code, done.stderr) == (2, 'error: no element "queu"; did you mean "queue"?\n')


def test_a_broken_plugin_is_code_1_and_still_listed(register: Register) -> None:
    """Listing imports nothing; describing it names package, cause and remedy."""
    register(halfbaked="no_such_module:Thing")
    assert any(line.startswith("halfbaked ") for line in inspect().stdout.splitlines())
    done = inspect("halfbaked")
    assert done.exit_code == 1
    assert "ModuleNotFoundError: No module named 'no_such_module'" in done.stderr
    assert "reinstall or update" in done.stderr


CORE = ("appsink", "appsrc", "capsfilter", "fakesink", "fakesrc", "identity", "queue", "tee")


@pytest.mark.parametrize("name", CORE)
def test_every_core_element_is_documented(name: str) -> None:
    """A sentence, a doc for each property, and an example that can be built."""
    from streamkit.graph.build import build

    found = facts(name)
    assert found["doc"].endswith(".")
    assert all(item["doc"].endswith(".") for item in found["properties"])
    built = build(found["example"], {})
    assert name in {element.factory for element in built.elements}


@pytest.mark.parametrize("arguments", [(), ("particletrack",)])
def test_lines_fit_the_terminal(arguments: tuple[str, ...]) -> None:
    """The words are the same; a program gets each sentence in one line."""
    command = [str(Path(sys.executable).with_name("streamkit")), "inspect", *arguments]
    piped = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    master, slave = pty.openpty()
    environment = {**os.environ, "COLUMNS": "80", "NO_COLOR": "1"}
    with subprocess.Popen(command, stdout=slave, env=environment) as process:
        os.close(slave)
        shown = b""
        with contextlib.suppress(OSError):  # how Linux reports the end of a terminal
            while part := os.read(master, 65536):
                shown += part
        os.close(master)
    assert process.returncode == 0
    lines = shown.decode().splitlines()
    assert max(map(len, lines)) <= 80 < max(map(len, piped.splitlines()))
    assert " ".join(lines).split() == piped.split()
