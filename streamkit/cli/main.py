"""The command `streamkit`: imports only the command that was asked for, so that it starts quickly."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import typer

from streamkit.cli.commands import CORE, CommandEntry, add_command, installed_commands

INTERRUPTED = 130


def version(show: bool = typer.Option(False, "--version", help="Print the version and leave.")) -> None:
    """Streams frames through graphs of elements: drone video in, tracks out."""
    if show:
        from importlib.metadata import version as installed

        typer.echo(f"streamkit {installed('streamkit')}")
        raise typer.Exit


def make_app(arguments: Sequence[str]) -> typer.Typer:
    """The application with the command that the arguments begin with, or with all where they name none."""
    app = typer.Typer(
        name="streamkit",
        help="Streams frames through graphs of elements: drone video in, tracks out.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    app.callback(invoke_without_command=True)(version)
    for entry in wanted_commands(arguments[0] if arguments else ""):
        add_command(app, entry)
    return app


def wanted_commands(name: str) -> list[CommandEntry]:
    """The command of that name, or all where there is none; packages are searched only if they must be."""
    if name in CORE:
        return [CommandEntry(name, CORE[name])]
    known = installed_commands()
    return [known[name]] if name in known else list(known.values())


def main() -> None:
    """Entry point of the command line."""
    try:
        make_app(sys.argv[1:])()
    except KeyboardInterrupt:  # before a command watches for it itself
        sys.exit(INTERRUPTED)
