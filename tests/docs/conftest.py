"""The commands of the pages, called in a folder."""

from collections.abc import Callable, Sequence
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest
import typer

from tests import command_line

Call = Callable[[Sequence[str], Path], CompletedProcess[str]]


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch) -> Call:
    """Calls `streamkit` with some words in a folder."""

    def leave(code: int, **_: Any) -> None:
        raise typer.Exit(code)

    monkeypatch.setattr("streamkit.cli.launch._exit", leave)
    monkeypatch.setattr("streamkit.cli.launch.share_cores", lambda _: None)  # it changes the environment

    def run(words: Sequence[str], folder: Path) -> CompletedProcess[str]:
        monkeypatch.chdir(folder)
        return command_line.run(*words)

    return run
