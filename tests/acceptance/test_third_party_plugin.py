"""A plugin of a third party: installed by pip, found by name, and alone with its faults."""

import importlib.metadata
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

FIXTURES = Path(__file__).parents[1] / "fixtures"
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def streamkit(make_environment: Callable[[], Any]) -> Run:
    """Runs the command in a fresh environment, with both plugins installed into it."""
    environment = make_environment()
    plugins = [str(FIXTURES / name) for name in ("third_party_plugin", "broken_plugin")]
    installed = environment.run("pip", "install", *plugins)
    assert installed.returncode == 0, installed.stderr
    return lambda *arguments: environment.run("streamkit", *arguments)


def test_both_plugins_are_listed(streamkit: Run) -> None:
    """With package and version; a broken one does not keep the others from being listed."""
    done = streamkit("inspect", "--json")
    assert done.returncode == 0, done.stderr
    rows = {row["name"]: row for row in json.loads(done.stdout)}
    assert (rows["examplegain"]["package"], rows["examplegain"]["version"]) == ("example-gain", "1.2.3")
    assert (rows["brokenelement"]["package"], rows["brokenelement"]["version"]) == ("broken-plugin", "0.0.1")
    assert rows["queue"]["package"] == "streamkit"


def test_a_plugin_is_documented(streamkit: Run) -> None:
    """Doc, property and example come from the declaration."""
    text = streamkit("inspect", "examplegain").stdout
    assert "examplegain - Repeats the bytes of each frame." in text
    assert "Transform of example-gain 1.2.3 (examplegain:ExampleGain)" in text
    assert "factor  (int 1..10; default 2, may change while playing)" in text
    assert 'streamkit launch "fakesrc num-buffers=3 sizemax=2 ! examplegain factor=3 ! fakesink"' in text


def test_a_plugin_runs_in_a_pipeline(streamkit: Run) -> None:
    """Beside ours, with its property set in the text."""
    done = streamkit(
        "launch", "--stats=json", "fakesrc num-buffers=3 ! queue ! examplegain factor=3 ! fakesink"
    )
    assert done.returncode == 0, done.stderr
    rows = {row["element"]: row for row in json.loads(done.stdout)["elements"]}
    assert (rows["examplegain0"]["frames_in"], rows["examplegain0"]["frames_out"]) == (3, 3)
    refused = streamkit("launch", "fakesrc ! examplegain factor=11 ! fakesink")
    assert refused.returncode == 2
    assert "examplegain0: property factor cannot be 11: it takes int 1..10" in refused.stderr


def test_a_broken_plugin_fails_alone(streamkit: Run) -> None:
    """Its use is an error that names element, package, version, cause and remedy; other pipelines run."""
    assert streamkit("launch", "fakesrc num-buffers=1 ! fakesink").returncode == 0
    done = streamkit("launch", "--json-errors", "fakesrc ! brokenelement ! fakesink")
    assert done.returncode == 2
    error = json.loads(done.stderr)["error"]
    assert (error["code"], error["line"], error["column"], error["length"]) == ("plugin-broken", 1, 11, 13)
    assert error["message"] == (
        "element 'brokenelement' (brokenplugin:BrokenElement, broken-plugin 0.0.1) cannot be loaded: "
        "RuntimeError: this machine has no flux capacitor; reinstall or update broken-plugin, "
        "or tell its author"
    )
    inspected = streamkit("inspect", "brokenelement")
    assert inspected.returncode == 1
    assert "this machine has no flux capacitor" in inspected.stderr
    assert "Traceback" not in inspected.stderr


def test_the_environment_of_the_tests_is_untouched(streamkit: Run) -> None:
    """The plugins are in the fresh environment only."""
    assert "examplegain" in streamkit("inspect").stdout
    names = {entry.name for entry in importlib.metadata.entry_points(group="streamkit.elements")}
    assert not names & {"examplegain", "brokenelement"}
