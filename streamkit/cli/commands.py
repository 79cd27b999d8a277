"""The commands there are: the engine's own, and those that installed plugins bring.

A plugin brings a command through the entry-point group `streamkit.commands`, `name = "module:function"`: a
function as typer takes it, or a `typer.Typer` with subcommands. It is imported when it is asked for.
"""

from __future__ import annotations

import importlib
import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn, TypeVar

import typer
from typer.core import TyperCommand

from streamkit.errors import PluginBroken

Function = TypeVar("Function", bound=Callable[..., Any])
GROUP = "streamkit.commands"
CORE = {name: f"streamkit.cli.{name}:{name}" for name in ("launch", "inspect", "graph", "caps", "new")}


@dataclass(frozen=True, slots=True)
class CommandEntry:
    """A command that an installed package offers; nothing of it is imported yet.

    Attributes:
        name: as typed.
        target: "module:function".
        distribution: who offers it; None for the engine's own.
    """

    name: str
    target: str
    distribution: importlib.metadata.Distribution | None = None

    @property
    def package(self) -> str:
        """Name of the distribution."""
        if self.distribution is not None:
            return self.distribution.name
        return "streamkit" if CORE.get(self.name) == self.target else "unknown package"

    @property
    def where(self) -> str:
        """Command, function and package in a few words."""
        version = f" {self.distribution.version}" if self.distribution else ""
        return f"command {self.name!r} ({self.target}, {self.package}{version})"


def installed_commands() -> dict[str, CommandEntry]:
    """All commands by name, the engine's first; of two with one name the first found wins."""
    found = {name: CommandEntry(name, target) for name, target in CORE.items()}
    for entry in sorted(importlib.metadata.entry_points(group=GROUP), key=lambda entry: entry.name):
        found.setdefault(entry.name, CommandEntry(entry.name, entry.value, entry.dist))
    return found


def load_command(entry: CommandEntry) -> Callable[..., Any] | typer.Typer:
    """The function of a command, or its application of subcommands, imported now.

    Raises:
        PluginBroken: it cannot be imported, or cannot be called.
    """
    module_name, _, name = entry.target.partition(":")
    try:
        found: Any = getattr(importlib.import_module(module_name), name)
    except Exception as cause:
        raise PluginBroken(
            f"{entry.where} cannot be loaded: {type(cause).__name__}: {cause}; "
            f"reinstall or update {entry.package}, or tell its author"
        ) from cause
    if not callable(found):
        raise PluginBroken(f"{entry.where} must be a function, got {found!r}; tell its author")
    command: Callable[..., Any] | typer.Typer = found
    return command


def add_command(app: typer.Typer, entry: CommandEntry) -> None:
    """Puts a command into an application; one that cannot be loaded tells so when it is called."""
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


def parsed_by(command_class: type[TyperCommand]) -> Callable[[Function], Function]:
    """Marks a function whose arguments are read by a class of its own."""

    def mark(function: Function) -> Function:
        function.__dict__["command_class"] = command_class
        return function

    return mark


def _refusal(text: str) -> Callable[[], NoReturn]:
    def refuse() -> NoReturn:
        typer.echo(f"error: {text}", err=True)
        raise typer.Exit(1)

    return refuse
