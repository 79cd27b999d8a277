"""Commands of the engine and of installed plugins.

A plugin adds a command in the entry-point group `streamkit.commands`, `name = "module:function"`: a function
for typer, or a `typer.Typer` with subcommands. It is imported when it is used.
"""

from __future__ import annotations

import importlib.metadata
import os
import shlex
import sys
from collections.abc import Callable
from typing import Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup
from typing_extensions import override

from streamkit.cli.stderr import fail, fail_usage
from streamkit.element.entries import PluginEntry, entries_by_name, installed_entries
from streamkit.errors import PluginBroken, StreamkitError
from streamkit.masking import mask_secrets

Function = TypeVar("Function", bound=Callable[..., Any])
GROUP = "streamkit.commands"
CORE = {
    name: PluginEntry("command", name, f"streamkit.cli.{name}:{name}")
    for name in ("launch", "inspect", "graph", "caps", "new", "prepare", "man")
}
FILE_COMMANDS = ("doctor", "view")  # of plugins, for a file or address
SUMMARY = "Streams frames through graphs of elements: drone video in, tracks out."


def installed_commands() -> dict[str, PluginEntry]:
    """All commands by name; streamkit's own win."""
    return entries_by_name(installed_entries("command", GROUP)) | CORE


class CommandGroup(TyperGroup):
    """The commands of entry points; only the one that is called is imported."""

    @override
    def list_commands(self, ctx: Any) -> list[str]:
        self.commands = {name: _listed(entry) for name, entry in installed_commands().items()}
        return list(self.commands)

    @override
    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name = args[0]
        entry = CORE.get(name) or installed_commands().get(name)
        if entry is None:
            if "!" in " ".join(args) or name.endswith(".pipe"):
                words = ["-f", *args] if name.endswith(".pipe") else args
                fail_usage(f"{name!r} is no command; did you mean: streamkit launch {shlex.join(words)}")
            if "://" in name or os.path.isfile(name):
                self._offer_file_commands(args)
            self.list_commands(ctx)  # for the suggestion
            return super().resolve_command(ctx, args)
        return name, load_command(entry), args[1:]

    def _offer_file_commands(self, args: list[str]) -> None:
        known = [command for command in FILE_COMMANDS if command in installed_commands()]
        if lines := " or ".join(f"streamkit {command} {shlex.join(args)}" for command in known):
            fail_usage(mask_secrets(f"{args[0]!r} is no command; did you mean: {lines}"))

    def invoke(self, ctx: Any) -> Any:
        """Runs a command; an error of streamkit's own ends it, with code 2 for what the user wrote."""
        try:
            return super().invoke(ctx)
        except StreamkitError as error:
            fail(error)


def _listed(entry: PluginEntry) -> Any:
    """A command for the listing."""
    text = None if entry.target.partition(":")[0] in sys.modules else entry.docstring()
    return load_command(entry) if text is None else TyperCommand(entry.name, help=text)


def load_command(entry: PluginEntry) -> Any:
    """Imports a command; one that cannot be loaded reports that when it is called."""
    app = typer.Typer(add_completion=False)
    try:
        found = entry.load()
        if not callable(found):
            raise PluginBroken(f"{entry.where} must be a function, got {found!r}; tell its author")
    except PluginBroken as error:
        reason = str(error)

        def refuse() -> None:
            raise PluginBroken(reason)

        free = {"allow_extra_args": True, "ignore_unknown_options": True}
        cause = f"(cannot be loaded: {type(error.__cause__).__name__})"
        app.command(entry.name, help=cause, context_settings=free)(refuse)
        return typer.main.get_command(app)
    if isinstance(found, typer.Typer):
        group = typer.main.get_command(found)
        group.name = entry.name  # the listing prints it
        return _reflowed(group)
    app.command(entry.name, cls=found.__dict__.get("command_class"))(found)
    return _reflowed(typer.main.get_command(app))


def _reflowed(command: Any) -> Any:
    """The same command; the paragraphs of its help fit the terminal, not the lines of the source."""
    if command.help:
        command.help = "\n\n".join(" ".join(text.split()) for text in command.help.split("\n\n"))
    for sub in getattr(command, "commands", {}).values():
        _reflowed(sub)
    return command


def parsed_by(command_class: type[TyperCommand]) -> Callable[[Function], Function]:
    """Decorator: parses the arguments of a command with a class of its own."""

    def mark(function: Function) -> Function:
        function.__dict__["command_class"] = command_class
        return function

    return mark


def version(show: bool = typer.Option(False, "--version", help="Print the version and leave.")) -> None:
    """Prints the version if asked to."""
    if show:
        typer.echo(f"streamkit {importlib.metadata.version('streamkit')}")
        raise typer.Exit
