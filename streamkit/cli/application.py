"""The typer application with the commands that the arguments may name."""

from __future__ import annotations

from collections.abc import Sequence

import typer

from streamkit.cli.commands import CORE, add_command, installed_commands, list_command
from streamkit.element.entries import PluginEntry


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
