"""What the Tab key offers in a shell."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit.cli.completion import complete_description
from tests.slowness import patience

BINARY = str(Path(sys.executable).with_name("streamkit"))


@pytest.mark.parametrize(
    ("words", "incomplete", "offered"),
    [
        ([], "videotests", ["videotestsrc"]),
        (["videotestsrc", "!"], "framed", ["framediff"]),
        ([], "videotestsrc num-buffers=3 ! framed", ["framediff", "framediff !"]),
        ([], "videotestsrc ! tee name=t ! fakesink t. ! tracks", ["tracksink", "tracksrc"]),
        (["videotestsrc"], "num-b", ["num-buffers="]),
        ([], "videotestsrc num-b", ["num-buffers=", "num-buffers=VALUE"]),
        (["videotestsrc", "num-buffers=3"], "is-l", ["is-live="]),
        (["videotestsrc", "pattern", "=", "ball"], "is-l", ["is-live="]),
        (["videotestsrc"], "pattern=bl", ["pattern=black", "pattern=blue", "pattern=blink"]),
        (["videotestsrc", "is-live", "="], "t", ["true"]),
        ([], "videotestsrc is-live=", ["is-live=true", "is-live=false"]),
        (["videotestsrc", "!", "video/x-raw,", "width=320", "!"], "framed", ["framediff"]),
        (["nosuchelement"], "a", []),
        (["videotestsrc"], "nosuch=t", []),
        (["="], "t", []),
        (["!", "!"], "nosuch", []),
    ],
)
def test_the_last_word_is_completed(words: list[str], incomplete: str, offered: list[str]) -> None:
    """In quotes, where it is the end of one word of the shell, and without.

    A shell closes the quotes after the only way to complete, therefore there are two.
    """
    found = complete_description(words, incomplete)
    kept = incomplete.rpartition(" ")[0]
    assert found == [f"{kept} {word}" if kept and kept not in word else word for word in offered]


@given(st.lists(st.text(" !=.({aé\"'v", max_size=5), max_size=5), st.text(" !=.({aé\"'v", max_size=9))
def test_no_line_is_an_error(words: list[str], incomplete: str) -> None:
    """Whatever has been typed so far, the words offered continue it."""
    kept = incomplete.rpartition(" ")[0]
    assert all(word.startswith(kept) for word in complete_description(words, incomplete))


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("streamkit la", ["launch"]),
        ("streamkit launch -v videotestsrc ! framed", ["framediff"]),
        (
            'streamkit launch "videotestsrc ! framed',
            ["videotestsrc ! framediff", "videotestsrc ! framediff !"],
        ),
        ('streamkit launch "videotests', ["videotestsrc", "videotestsrc !"]),
        ("streamkit\nlaunch\nvideotestsrc\nis-live\n=", ["true", "false"]),
        (
            'streamkit launch "videotestsrc is-live=',
            ["videotestsrc is-live=true", "videotestsrc is-live=false"],
        ),
        ("streamkit graph videotests", ["videotestsrc"]),
        ("streamkit inspect particlet", ["particletrack"]),
    ],
)
def test_bash_gets_it_from_the_command(line: str, offered: list[str]) -> None:
    """As the script of --install-completion asks for it."""
    count = 2 if '"' in line else len(line.split()) - 1
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(count), "_STREAMKIT_COMPLETE": "complete_bash"}
    done = subprocess.run(
        [BINARY],
        env={**os.environ, **asked},
        capture_output=True,
        text=True,
        timeout=patience(30),
        check=False,
    )
    assert (done.stdout.splitlines(), done.stderr) == (offered, "")


@pytest.mark.parametrize("command", [BINARY, f"{sys.executable} -m streamkit"])
def test_the_script_is_installed_for_a_shell(tmp_path: Path, command: str) -> None:
    """The start file of the shell in which it is called reads it; it completes the command `streamkit`."""
    done = subprocess.run(
        ["bash", "-c", f"{command} --install-completion && true"], env={**os.environ, "HOME": str(tmp_path)},
        capture_output=True, text=True, timeout=patience(30), check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    script = tmp_path / ".bash_completions/streamkit.sh"
    assert str(script) in (tmp_path / ".bashrc").read_text()
    assert script.read_text().rstrip().endswith("_streamkit_completion streamkit")
