"""The commands of the pages, called in the process of the tests: most of a short one is its start."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import typer
from click.testing import Result
from typer.testing import CliRunner

from streamkit.cli.main import make_app

Call = Callable[[Sequence[str], Path], Result]


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch) -> Call:
    """Calls `streamkit` with some words in a folder."""

    def leave(code: int, **_: Any) -> None:
        raise typer.Exit(code)

    monkeypatch.setattr("streamkit.cli.launch._exit", leave)
    monkeypatch.setattr("streamkit.cli.launch.share_cores", lambda _: None)  # it changes the environment

    def run(words: Sequence[str], folder: Path) -> Result:
        monkeypatch.chdir(folder)
        return CliRunner().invoke(make_app(), list(words), env={"COLUMNS": "200"})

    return run
