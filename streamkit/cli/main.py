"""The command `streamkit`: collects the commands; each imports what it needs when it runs."""

from __future__ import annotations

import typer

from streamkit.cli.graph import graph
from streamkit.cli.inspect import inspect
from streamkit.cli.launch import launch
from streamkit.cli.subscribe import subscribe

app = typer.Typer(
    name="streamkit",
    help="Streams frames through graphs of elements: drone video in, tracks out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(launch)
app.command()(inspect)
app.command()(graph)
app.command()(subscribe)


@app.callback(invoke_without_command=True)
def version(show: bool = typer.Option(False, "--version", help="Print the version and leave.")) -> None:
    """Streams frames through graphs of elements: drone video in, tracks out."""
    if show:
        from importlib.metadata import version as installed

        typer.echo(f"streamkit {installed('streamkit')}")
        raise typer.Exit


def main() -> None:
    """Entry point of the command line."""
    app()
