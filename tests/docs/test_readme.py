"""Every command and every listing in the README runs."""

import re
import shlex
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, re.DOTALL)
COMMANDS = [
    command.strip()
    for language, block in BLOCKS
    if language == "sh"
    for command in block.replace("\\\n", " ").splitlines()
    if command.strip() and not command.strip().startswith("#")
]
RUN = re.compile(r"streamkit (launch|explain|tracks|convert|report)\b")
LAUNCHES = [command for command in COMMANDS if RUN.match(command)]
NEEDS_PEER = ("rtsp://",)
Call = Callable[[list[str], Path], subprocess.CompletedProcess[str]]


def commands_of(*verbs: str) -> list[str]:
    """The lines that call one of these commands of streamkit."""
    return [command for command in COMMANDS if re.match(rf"streamkit ({'|'.join(verbs)})\b", command)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the ready pipelines, as the README's reader has it."""
    place = tmp_path_factory.mktemp("readme")
    (place / "pipelines").symlink_to(ROOT / "pipelines")
    return place


def test_readme_names_the_two_commands() -> None:
    """The first thing a reader is asked to type is `make demo` and `make test`."""
    assert {"make demo", "make test"} <= {command.split("  ")[0].strip() for command in COMMANDS}


@pytest.mark.timeout(400)
def test_launch_lines_run_in_order(folder: Path, call: Call) -> None:
    """Each, and what reads its files, ends with exit code 0; one that needs a camera is built instead."""
    assert len(LAUNCHES) >= 5
    for command in LAUNCHES:
        needs_peer = any(mark in command for mark in NEEDS_PEER)
        line = command.replace("launch -e", "graph", 1) if needs_peer else command
        done = call(shlex.split(line)[1:], folder)
        assert done.returncode == 0, f"{command}\n{done.stderr}"


@pytest.mark.parametrize("command", commands_of("inspect", "graph", "caps", "new"))
def test_commands_without_a_stream_run(command: str, folder: Path, call: Call) -> None:
    """They end with exit code 0 and print something."""
    done = call(shlex.split(command)[1:], folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


@pytest.mark.parametrize("command", [*commands_of("subscribe", "doctor", "experiments"), "streamkit launch"])
def test_options_of_other_commands_are_there(
    command: str, folder: Path, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What needs a peer or data is asked for its help, which has every option that the README gives."""
    monkeypatch.setenv("COLUMNS", "200")
    words = shlex.split(command)
    done = call([words[1], "--help"], folder)
    assert done.returncode == 0, done.stderr
    for option in (word.partition("=")[0] for word in words if word.startswith("-")):
        assert option in done.stdout


def test_no_command_is_left_out() -> None:
    """Every line that begins with streamkit is in one of the tests here."""
    verbs = ("launch", "inspect", "graph", "caps", "new", "subscribe", "doctor", "experiments")
    known = {*LAUNCHES, *commands_of(*verbs)}
    assert [command for command in COMMANDS if command.startswith("streamkit") and command not in known] == []


def test_element_listing_runs(tmp_path: Path) -> None:
    """The element of the README works when it is pasted into a file."""
    listing = next(block for language, block in BLOCKS if language == "python" and "(Transform)" in block)
    script = tmp_path / "listing.py"
    script.write_text(
        textwrap.dedent(listing)
        + textwrap.dedent(
            """
            import numpy as np
            from streamkit import Frame, raw_video_caps
            from streamkit.testing import Harness

            name = next(n for n, c in list(globals().items()) if getattr(c, "__module__", "") == "__main__")
            caps = raw_video_caps("GRAY8", 4, 2)
            with Harness(globals()[name]()) as harness:
                first = harness.push(Frame(np.full((2, 4), 10, np.uint8), caps))
                second = harness.push(Frame(np.full((2, 4), 14, np.uint8), caps))
            assert first == [] and (second[0].data == 4).all(), (first, second)
            """
        ),
        encoding="utf-8",
    )
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
