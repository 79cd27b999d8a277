"""`streamkit prepare`: preparations of plugins."""

import importlib.metadata
import io
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from streamkit.cli import prepare as module
from streamkit.cli.main import make_app
from streamkit.cli.prepare import GROUP

Offer = Callable[..., None]


@pytest.fixture
def offer(monkeypatch: pytest.MonkeyPatch) -> Offer:
    """Makes preparations known, `offer(name="module:function")`; no others are."""

    def only(**targets: str) -> None:
        entries = [importlib.metadata.EntryPoint(name, target, GROUP) for name, target in targets.items()]
        monkeypatch.setattr(importlib.metadata, "entry_points", lambda **_: entries)

    return only


def prepare() -> Result:
    """Runs the command in this process; preparations run in their own."""
    return CliRunner().invoke(make_app(), ["prepare"])


def test_every_preparation_is_run_and_reported(offer: Offer) -> None:
    """With the seconds it took."""
    offer(second="gc:collect", first="gc:enable")
    result = prepare()
    assert result.exit_code == 0
    first, second = result.stdout.splitlines()
    assert first.startswith("first is ready after ")
    assert second.startswith("second is ready after ")


def test_a_failed_preparation_does_not_stop_the_others(
    offer: Offer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Name, function, cause and remedy; exit code 1."""
    (tmp_path / "silent.py").write_text("def run():\n    raise SystemExit(3)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    offer(bad="no_such_module:run", worse="silent:run", good="gc:collect")
    result = prepare()
    assert result.exit_code == 1
    assert "good is ready after " in result.stdout
    assert "bad (no_such_module:run) cannot be prepared: ModuleNotFoundError" in result.stderr
    assert "worse (silent:run) cannot be prepared: it ended with 3" in result.stderr


class Terminal(io.StringIO):
    """What a user sees."""

    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_what_is_waited_for(offer: Offer, monkeypatch: pytest.MonkeyPatch) -> None:
    """And for how long; the line is cleared before the result."""
    monkeypatch.setattr(module, "PROGRESS_S", 0.05)
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    offer(slow="any:thing")
    monkeypatch.setattr(module, "CALL", "import time; time.sleep(1)")
    module.prepare()
    assert "slow is being prepared, 0 s" in terminal.getvalue()
    assert terminal.getvalue().endswith(module.CLEAR)


def test_one_that_takes_too_long_is_ended(offer: Offer, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the limit as cause."""
    monkeypatch.setattr(module, "LIMIT_S", 0.2)
    monkeypatch.setattr(module, "CALL", "import time; time.sleep(60)")
    offer(slow="any:thing")
    result = prepare()
    assert (result.exit_code, result.stdout) == (1, "")
    assert "slow (any:thing) cannot be prepared: it took more than 0.2 s" in result.stderr


def test_nothing_to_prepare_is_no_error(offer: Offer) -> None:
    """No plugin has a preparation."""
    offer()
    assert prepare().exit_code == 0
