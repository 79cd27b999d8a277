"""The tutorial for authors is followed to the letter: each command is run, each listing is saved."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

TEXT = (Path(__file__).parents[2] / "docs" / "tutorial-first-element.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"(?P<before>(?:(?!```).)*?)```(?P<language>\w+)\n(?P<body>.*?)```", re.DOTALL)
FAILS = re.compile(r"<!-- ends with code (\d+) -->")


class Reader:
    """Does what the page says, in an environment of its own."""

    def __init__(self, environment: Any, folder: Path) -> None:
        self.environment = environment
        self.folder = folder
        self.output = ""
        self.commands = 0

    def follow(self, text: str) -> None:
        """Goes through the page from top to bottom."""
        for block in BLOCK.finditer(text):
            body, before = block["body"], block["before"]
            if block["language"] == "sh":
                code = FAILS.search(before)
                for line in body.splitlines():
                    self.run(line, int(code[1]) if code else 0)
            elif block["language"] == "python":
                (path,) = re.findall(r"Put this into\s+`([^`]+)`", before)
                assert (self.folder / path).exists(), f"{path}: the package has no such file"
                (self.folder / path).write_text(body, encoding="utf-8")
            elif block["language"] == "text":
                for line in body.splitlines():
                    assert line in self.output or (self.folder / line.split()[0]).exists(), line

    def run(self, line: str, code: int) -> None:
        """Runs one command of the shell."""
        self.commands += 1
        if line.startswith("cd "):
            self.folder /= line[3:]
            assert self.folder.is_dir()
            return
        done = self.environment.run("sh", "-c", line, cwd=self.folder)
        self.output = done.stdout + done.stderr
        assert done.returncode == code, f"{line}\n{self.output}"


@pytest.mark.timeout(180)
def test_the_tutorial_can_be_followed(make_environment: Callable[[], Any], tmp_path: Path) -> None:
    """Every command ends as the page says, every file is where it says, every output is as shown."""
    reader = Reader(make_environment(), tmp_path)
    reader.follow(TEXT)
    assert reader.commands >= 12
    assert (tmp_path / "motion-trail" / "trail.mp4").stat().st_size > 1000


def test_the_entry_point_of_a_command_is_the_real_one() -> None:
    """The last listing names the group that the command line reads."""
    from streamkit.cli.commands import GROUP

    assert f'[project.entry-points."{GROUP}"]' in TEXT
