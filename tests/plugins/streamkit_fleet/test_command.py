"""`streamkit fleet` and `streamkit batch` as commands; docs/fleet.md is followed by a test of its own."""

import re
from contextlib import nullcontext
from pathlib import Path

import pytest
from typer.testing import CliRunner

from streamkit.cli.main import make_app
from streamkit_fleet import local_ray
from streamkit_fleet.feed import FeedStatus
from streamkit_fleet.local_ray import LocalRay


def test_the_commands_are_listed_by_name() -> None:
    """A group of commands, too."""
    listing = CliRunner().invoke(make_app(), ["--help"], env={"COLUMNS": "200"}).stdout
    assert re.search(r"^\W*batch\s+Runs a pipeline over every file", listing, re.MULTILINE)
    assert re.search(r"^\W*fleet\s+Runs many feeds on Ray", listing, re.MULTILINE)


def test_without_a_fleet_the_remedy_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is started by asking how it is."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    done = CliRunner().invoke(make_app(), ["fleet", "status"], env={"COLUMNS": "200"})
    assert done.exit_code == 1
    assert done.stderr == "error: no fleet runs on this machine; start one with `streamkit fleet up`\n"
    assert list(tmp_path.iterdir()) == []


def test_a_table_with_a_mistake_starts_no_ray(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would go on running without a feed."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr("streamkit_fleet.local_ray.start", lambda _: pytest.fail("Ray is started"))
    table = tmp_path / "fleet.toml"
    table.write_text('[feeds.gate]\ntext = "fakesrc ! fakesink"\ncoers = 3\n')
    done = CliRunner().invoke(make_app(), ["fleet", "up", str(table)], env={"COLUMNS": "200"})
    assert done.exit_code == 1
    assert done.stderr == f"error: {table}: feed gate: Object contains unknown field `coers`\n"


def test_status_prints_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Texts of a column begin below each other; brackets in a reason are no markup."""
    rows = [
        FeedStatus(
            name="gate", state="playing", ready=True, cores=0.25, frames=1200, metrics="127.0.0.1:9464"
        ),
        FeedStatus(name="harbour-north", state="waiting", reason="[red] no frame", node="0123456789abcdef"),
    ]
    monkeypatch.setattr("streamkit_fleet.control.statuses", lambda: rows)
    monkeypatch.setattr("streamkit_fleet.local_ray.connected", lambda *_, **__: nullcontext())
    done = CliRunner().invoke(make_app(), ["fleet", "status", "--address", "127.0.0.1:1"])
    assert done.stdout.splitlines() == [
        "feed           state    node      cores  frames  dropped  restarts  metrics         missing",
        "gate           playing            0.25   1200    0        0         127.0.0.1:9464",
        "harbour-north  waiting  01234567  0.00   0       0        0                         [red] no frame",
    ]
    assert done.exit_code == 1


@pytest.mark.parametrize("arguments", [("logs", "gate"), ("status",), ("up", "fleet.toml")])
def test_a_fleet_that_ends_takes_no_command(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would wait for a minute for a Ray that goes."""
    monkeypatch.chdir(tmp_path)
    Path("fleet.toml").write_text('[feeds.gate]\ntext = "fakesrc ! fakesink"\n')
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr(local_ray, "_is_running", lambda _local: True)
    monkeypatch.setattr(local_ray, "connected", lambda *_, **__: pytest.fail("it connects"))
    (tmp_path / "streamkit").mkdir()
    local_ray.begin_end(LocalRay("127.0.0.1:1", 1))
    done = CliRunner().invoke(make_app(), ["fleet", *arguments], env={"COLUMNS": "200"})
    assert (done.exit_code, done.stdout) == (1, "")
    assert (
        done.stderr == "error: `streamkit fleet down` is ending the fleet of this machine; wait for its end\n"
    )
