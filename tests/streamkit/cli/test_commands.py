"""Commands: the engine's own and those of plugins, each imported when it is asked for."""

import importlib.metadata
import sys
import types
from collections.abc import Callable

import pytest
import typer
from typer.testing import CliRunner, Result

from streamkit.cli.commands import GROUP
from streamkit.cli.main import make_app

MODULE = "commands_of_a_test"
Offer = Callable[..., None]


@pytest.fixture
def offer(monkeypatch: pytest.MonkeyPatch) -> Offer:
    """Makes functions usable as commands, `offer(name=function)` or `offer(name="module:function")`."""
    module = types.ModuleType(MODULE)
    monkeypatch.setitem(sys.modules, MODULE, module)
    entry_points = importlib.metadata.entry_points
    added: list[importlib.metadata.EntryPoint] = []

    def with_added(**selection: str) -> list[importlib.metadata.EntryPoint]:
        mine = [entry for entry in added if entry.group == selection.get("group", entry.group)]
        return [*mine, *entry_points(**selection)]

    def add(**functions: object) -> None:
        for name, found in functions.items():
            setattr(module, name, found)
            target = found if isinstance(found, str) else f"{MODULE}:{name}"
            added.append(importlib.metadata.EntryPoint(name, target, GROUP))

    monkeypatch.setattr(importlib.metadata, "entry_points", with_added)
    return add


def streamkit(*arguments: str) -> Result:
    """Runs the command line in this process, as `main` does."""
    return CliRunner().invoke(make_app(arguments), arguments)


def greet(name: str) -> None:
    """Greets."""
    typer.echo(f"hello {name}")


def test_a_plugin_brings_a_command(offer: Offer) -> None:
    """Its function is called with its arguments and listed with its first line."""
    offer(greet=greet)
    assert streamkit("greet", "drone").stdout == "hello drone\n"
    listing = streamkit("--help").stdout
    assert "Greets." in listing
    for name in ("launch", "inspect", "graph", "new", "subscribe", "greet"):
        assert f" {name} " in listing


def test_a_plugin_brings_a_command_with_subcommands(offer: Offer) -> None:
    """Where the entry point names a typer application."""
    app = typer.Typer()
    app.command("one")(greet)
    app.command("two")(greet)
    offer(many=app)
    assert streamkit("many", "two", "drone").stdout == "hello drone\n"


def test_only_the_command_asked_for_is_imported(offer: Offer) -> None:
    """Another plugin's command is not even looked at."""
    offer(greet=greet, other="no_such_module:run")
    assert streamkit("greet", "drone").exit_code == 0
    assert "cannot be loaded" not in streamkit("greet", "--help").stdout


def test_a_broken_command_fails_alone(offer: Offer) -> None:
    """It is listed, and calling it names command, function, package, cause and remedy; others run."""
    offer(broken="no_such_module:run", greet=greet)
    assert "(cannot be loaded: ModuleNotFoundError)" in streamkit("--help").stdout
    done = streamkit("broken", "--anything", "x")
    assert done.exit_code == 1
    assert done.stderr == (
        "error: command 'broken' (no_such_module:run, unknown package) cannot be loaded: "
        "ModuleNotFoundError: No module named 'no_such_module'; "
        "reinstall or update unknown package, or tell its author\n"
    )
    assert streamkit("greet", "drone").exit_code == 0


def test_what_is_no_function_is_refused(offer: Offer) -> None:
    """With what it is."""
    offer(number=7)
    done = streamkit("number")
    assert done.exit_code == 1
    assert "must be a function, got 7; tell its author" in done.stderr


def test_an_unknown_command_is_code_2_with_a_suggestion(offer: Offer) -> None:
    """Commands of plugins are suggested too."""
    offer(greet=greet)
    for typed, meant in (("lunch", "launch"), ("greed", "greet")):
        done = streamkit(typed)
        assert done.exit_code == 2
        assert f"No such command '{typed}'. Did you mean '{meant}'?" in done.stderr


def test_the_engine_keeps_its_own_names(offer: Offer) -> None:
    """A plugin cannot put another command in the place of `launch`."""
    offer(launch=greet)
    assert "hello" not in streamkit("launch", "drone").output
