"""The command `launch`, called in the process of the tests."""

from collections.abc import Callable
from typing import Any

import pytest
import typer
from click.testing import Result
from typer.testing import CliRunner

from streamkit.cli.main import make_app


@pytest.fixture
def launch(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """Runs the command in this process, without leaving it."""

    def leave(code: int, **_: Any) -> None:
        raise typer.Exit(code)

    monkeypatch.setattr("streamkit.cli.launch._exit", leave)
    monkeypatch.setattr("streamkit.cli.launch.share_cores", lambda _: None)  # it changes the environment

    def run(*arguments: str, **options: Any) -> Result:
        return CliRunner().invoke(make_app(), ["launch", *arguments], **options)

    return run
