"""docs/fleet.md can be followed: its files are written, its commands run in order in one folder.

Its `streamkit batch` runs in `tests/plugins/streamkit_fleet/batch/test_driver.py`, which has a Ray already.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from streamkit_fleet.feeds import by_process, read_feeds
from tests.slowness import patience

PAGE = Path(__file__).parents[2] / "docs" / "fleet.md"
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)
BINARY = Path(sys.executable).with_name("streamkit")
LIMIT_S = 60.0  # of a command, on an idle machine


@pytest.mark.timeout(300)
def test_the_page_can_be_followed(tmp_path: Path) -> None:
    """A listing that opens with `# NAME` is a file; every call of streamkit ends with code 0."""
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path / "state")}
    try:
        follow(tmp_path, environment)
    finally:
        subprocess.run(
            [str(BINARY), "fleet", "down"], env=environment, timeout=patience(LIMIT_S), check=False
        )


def test_the_tables_are_valid(tmp_path: Path) -> None:
    """One for feeds with processes of their own, one for a process that is shared."""
    found = {}
    for body in re.findall(r"```toml\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL):
        (tmp_path / "table.toml").write_text(body, encoding="utf-8")
        found |= by_process(read_feeds(tmp_path / "table.toml"))
    assert {name: len(process.feeds) for name, process in found.items()} == {
        "feed:gate": 1,
        "feed:roof": 1,
        "process:light": 2,
    }


def follow(folder: Path, environment: dict[str, str]) -> None:
    """Writes the files and runs the commands of the page."""
    ran = 0
    for language, body in BLOCK.findall(PAGE.read_text("utf-8")):
        if name := re.match(r"# (\S+)\n", body):
            (folder / name[1]).write_text(body, encoding="utf-8")
        lines = body.replace("\\\n", " ").splitlines() if language == "sh" else []
        commands = [line for line in lines if re.match(r"streamkit (?!batch )", line)]
        for words in (shlex.split(line, comments=True) for line in commands):
            done = subprocess.run(
                [str(BINARY), *words[1:]], cwd=folder, capture_output=True, text=True, check=False,
                timeout=patience(LIMIT_S), env=environment,
            )  # fmt: skip
            assert done.returncode == 0, f"{shlex.join(words)}\n{done.stderr}"
            ran += 1
    assert ran
