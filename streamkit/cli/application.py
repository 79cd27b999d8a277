"""What the arguments of the command line make: the application with the commands they may mean."""

from __future__ import annotations

from collections.abc import Sequence

import typer

from streamkit.cli.commands import CORE, CommandEntry, add_command, installed_commands, list_command


def version(show: bool = typer.Option(False, "--version", help="Print the version and leave.")) -> None:
    """Streams frames through graphs of elements: drone video in, tracks out."""
    if show:
        from importlib.metadata import version as installed

        typer.echo(f"streamkit {installed('streamkit')}")
        raise typer.Exit


def application(arguments: Sequence[str]) -> typer.Typer:
    """The application with the command that the arguments begin with.

    Where they begin with none, all are listed by what their source says of them, and imported when called.
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


def _command_named(name: str) -> CommandEntry | None:
    """The command of that name; packages are searched only if they must be."""
    return CommandEntry(name, CORE[name]) if name in CORE else installed_commands().get(name)
