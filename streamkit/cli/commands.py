"""Commands of the engine and of installed plugins.

A plugin adds a command in the entry-point group `streamkit.commands`, `name = "module:function"`: a function
for typer, or a `typer.Typer` with subcommands. It is imported when it is used.
"""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import typer
from typer.core import TyperCommand

from streamkit.element.entries import PluginEntry
from streamkit.errors import PluginBroken
from streamkit.masking import presentable

Function = TypeVar("Function", bound=Callable[..., Any])
GROUP = "streamkit.commands"
CORE = {
    name: f"streamkit.cli.{name}:{name}" for name in ("launch", "inspect", "graph", "caps", "new", "prepare")
}


def installed_commands() -> dict[str, PluginEntry]:
    """All commands by name, the engine's first; the first of a name wins."""
    found = {name: PluginEntry("command", name, target) for name, target in CORE.items()}
    for entry in sorted(importlib.metadata.entry_points(group=GROUP), key=lambda entry: entry.name):
        found.setdefault(entry.name, PluginEntry("command", entry.name, entry.value, entry.dist))
    return found


def load_command(entry: PluginEntry) -> Callable[..., Any] | typer.Typer:
    """Imports the function of a command, or its `typer.Typer`; raises `PluginBroken`."""
    found = entry.load()
    if not callable(found):
        raise PluginBroken(f"{entry.where} must be a function, got {found!r}; tell its author")
    command: Callable[..., Any] | typer.Typer = found
    return command


def add_command(app: typer.Typer, entry: PluginEntry) -> None:
    """Adds a command to an application; one that cannot be loaded reports that when called."""
    try:
        command = load_command(entry)
    except PluginBroken as error:
        app.command(
            entry.name,
            help=f"(cannot be loaded: {type(error.__cause__).__name__})",
            context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
        )(_refusal(str(error)))
        return
    if isinstance(command, typer.Typer):
        app.add_typer(command, name=entry.name)
    else:
        app.command(entry.name, cls=command.__dict__.get("command_class"))(command)


def list_command(app: typer.Typer, entry: PluginEntry, call: Callable[[Sequence[str]], object]) -> None:
    """Adds a command with the docstring in its source; importing all commands would take seconds.

    Args:
        app: the application.
        entry: the command.
        call: runs the command line, the command's name first.
    """
    text = described(entry)
    if text is None:
        add_command(app, entry)
        return

    def run(context: typer.Context) -> None:
        call([entry.name, *context.args])

    free = {"allow_extra_args": True, "ignore_unknown_options": True}
    app.command(entry.name, help=text, context_settings=free, add_help_option=False)(run)


def described(entry: PluginEntry) -> str | None:
    """The docstring of a command's function, read without importing it, or None."""
    import ast
    from importlib.util import find_spec

    module_name, _, name = entry.target.partition(":")
    if module_name in sys.modules:
        return None
    try:
        spec = find_spec(module_name)
        if spec is None or spec.origin is None:
            return None
        tree = ast.parse(Path(spec.origin).read_bytes())
    except Exception:  # loading the package reports the cause
        return None
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name]
    return ast.get_docstring(functions[0]) if functions else None


def parsed_by(command_class: type[TyperCommand]) -> Callable[[Function], Function]:
    """Decorator: parses the arguments of a command with a class of its own."""

    def mark(function: Function) -> Function:
        function.__dict__["command_class"] = command_class
        return function

    return mark


def _refusal(text: str) -> Callable[[], NoReturn]:
    def refuse() -> NoReturn:
        typer.echo(f"error: {presentable(text)}", err=True)
        raise typer.Exit(1)

    return refuse


def version(show: bool = typer.Option(False, "--version", help="Print the version and leave.")) -> None:
    """Streams frames through graphs of elements: drone video in, tracks out."""
    if show:
        from importlib.metadata import version as installed

        typer.echo(f"streamkit {installed('streamkit')}")
        raise typer.Exit


def application(arguments: Sequence[str]) -> typer.Typer:
    """The application with the command named first in the arguments.

    Without one, all commands are listed with the docstrings in their source, and imported when called.
    """
    app = typer.Typer(
        name="streamkit",
        help="Streams frames through graphs of elements: drone video in, tracks out.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    app.callback(invoke_without_command=True)(version)
    wanted = _command_named(arguments[0]) if arguments else None
    if wanted is not None:
        add_command(app, wanted)
        return app
    for entry in installed_commands().values():
        list_command(app, entry, lambda words: application(words)(words))
    return app


def _command_named(name: str) -> PluginEntry | None:
    """The command of a name; searches installed packages only if necessary."""
    return PluginEntry("command", name, CORE[name]) if name in CORE else installed_commands().get(name)
