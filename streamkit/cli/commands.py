"""The commands there are: the engine's own, and those that installed plugins bring.

A plugin brings a command through the entry-point group `streamkit.commands`, `name = "module:function"`: a
function as typer takes it, or a `typer.Typer` with subcommands. It is imported when it is asked for.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import typer
from typer.core import TyperCommand

from streamkit.errors import PluginBroken
from streamkit.masking import presentable

Function = TypeVar("Function", bound=Callable[..., Any])
GROUP = "streamkit.commands"
CORE = {
    name: f"streamkit.cli.{name}:{name}" for name in ("launch", "inspect", "graph", "caps", "new", "prepare")
}


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


def list_command(app: typer.Typer, entry: CommandEntry, call: Callable[[Sequence[str]], object]) -> None:
    """Puts a command into an application as its source describes it; importing all would take seconds.

    Args:
        app: the application.
        entry: the command.
        call: runs the whole command line, the command's name first, should it be called.
    """
    said = described(entry)
    if said is None:
        add_command(app, entry)
        return

    def run(context: typer.Context) -> None:
        call([entry.name, *context.args])

    free = {"allow_extra_args": True, "ignore_unknown_options": True}
    app.command(entry.name, help=said, context_settings=free, add_help_option=False)(run)


def described(entry: CommandEntry) -> str | None:
    """The docstring of a command's function, read without importing it; None where that cannot be."""
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
    except Exception:  # a package may do anything when found; loading it tells what
        return None
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name]
    return ast.get_docstring(functions[0]) if functions else None


def parsed_by(command_class: type[TyperCommand]) -> Callable[[Function], Function]:
    """Marks a function whose arguments are read by a class of its own."""

    def mark(function: Function) -> Function:
        function.__dict__["command_class"] = command_class
        return function

    return mark


def _refusal(text: str) -> Callable[[], NoReturn]:
    def refuse() -> NoReturn:
        typer.echo(f"error: {presentable(text)}", err=True)
        raise typer.Exit(1)

    return refuse
