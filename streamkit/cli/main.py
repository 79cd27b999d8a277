"""The command `streamkit`: imports only the command that was asked for, so that it starts quickly."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

import typer

COMMANDS = ("launch", "inspect", "graph", "subscribe")


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
    for name in arguments[:1] if arguments[:1] and arguments[0] in COMMANDS else COMMANDS:
        app.command(name)(getattr(importlib.import_module(f"streamkit.cli.{name}"), name))
    return app


def main() -> None:
    """Entry point of the command line."""
    make_app(sys.argv[1:])()
