"""`streamkit man`: manual pages of the commands, from the declarations that `--help` prints."""

from __future__ import annotations

import importlib.metadata
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from streamkit.cli.commands import SUMMARY
from streamkit.cli.main import make_app
from streamkit.cli.stderr import exit_with_error
from streamkit.masking import presentable

DEFAULT = Path("~/.local/share/man/man1")


def man(
    folder: Annotated[
        Path, typer.Argument(help="Where to write them; man finds those in the default.")
    ] = DEFAULT,
) -> None:
    """Writes manual pages of all commands: `man streamkit`, `man streamkit-launch`."""
    target = folder.expanduser()
    count = 0
    try:
        target.mkdir(parents=True, exist_ok=True)
        for name, text in pages():
            (target / f"{name}.1").write_text(text, encoding="utf-8")
            count += 1
    except OSError as error:
        exit_with_error(f"{folder} cannot be written: {error.strerror}")
    where = presentable(str(target))
    command = "man streamkit" if folder == DEFAULT else f"man -l {shlex.quote(f'{where}/streamkit.1')}"
    typer.echo(f"{count} pages in {where}; read them with: {command}")


def pages() -> Iterator[tuple[str, str]]:
    """The name and text of each page, in man's language."""
    return _pages("streamkit", typer.main.get_command(make_app()), SUMMARY)


def _pages(path: str, command: Any, summary: str) -> Iterator[tuple[str, str]]:
    """The pages of a command and its subcommands; `path` is its name with those of its groups."""
    context = command.make_context(path, [], resilient_parsing=True)
    names = command.list_commands(context) if hasattr(command, "list_commands") else []
    found = {name: command.get_command(context, name) for name in names}
    commands = {name: sub for name, sub in found.items() if sub is not None and not sub.hidden}
    yield path.replace(" ", "-"), page(path, command, context, summary, commands)
    for name, sub in commands.items():
        _, loaded, _ = command.resolve_command(context, [name])
        yield from _pages(f"{path} {name}", loaded, _summary(sub))


def page(path: str, command: Any, context: Any, summary: str, commands: dict[str, Any]) -> str:
    """One page.

    Args:
        path: the command with those before it, "streamkit fleet up".
        command: of click.
        context: of the command.
        summary: what it does, in a line.
        commands: its subcommands.
    """
    name = path.replace(" ", "-")
    version = importlib.metadata.version("streamkit")
    usage = " ".join(command.collect_usage_pieces(context))
    lines = [f'.TH "{name.upper()}" 1 "" "streamkit {version}" "streamkit"', ".SH NAME"]
    lines += [
        f"{_escaped(name)} \\- {_escaped(summary)}",
        ".SH SYNOPSIS",
        f".B {_escaped(path)}",
        _escaped(usage),
    ]
    _, *body = (command.help or summary).split("\n\n")
    lines += [".SH DESCRIPTION"] * bool(body)
    for paragraph in body:
        lines += [".PP", _escaped(" ".join(paragraph.split()))]
    records = [parameter.get_help_record(context) for parameter in command.get_params(context)]
    lines += _list("OPTIONS", [record for record in records if record])
    lines += _list("COMMANDS", [(sub, _summary(found)) for sub, found in commands.items()])
    return "\n".join(lines) + "\n"


def _list(title: str, items: list[tuple[str, str]]) -> list[str]:
    """A section of terms and what they mean."""
    lines = [f".SH {title}"] if items else []
    for term, text in items:
        lines += [".TP", f".B {_escaped(term)}", _escaped(" ".join(text.split()))]
    return lines


def _summary(command: Any) -> str:
    return " ".join((command.help or "").partition("\n\n")[0].split())


def _escaped(text: str) -> str:
    """Text that man prints as it is."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{text}" if text[:1] in (".", "'") else text
