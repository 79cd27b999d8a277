"""Reads the description for `launch` and `graph` from arguments or a file, with variables."""

from __future__ import annotations

import io
import json
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from streamkit.cli.stderr import USAGE_EXIT, fail_usage, print_line, prints_json
from streamkit.errors import DescriptionError
from streamkit.output.colour import coloured
from streamkit.output.pipe import STANDARD_INPUT

if TYPE_CHECKING:
    from streamkit.graph.graph import Graph

SIZE_LIMIT = 1_000_000
BLANK_OR_QUOTED = re.compile(r'"(?:(?<=\\)"|[^"])*"?| ')  # in quotes an escaped one does not close


def _complete(context: typer.Context, incomplete: str) -> list[str]:
    from streamkit.cli.completion import complete_description, has_open_quote

    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")  # bash; others
    words = context.params.get("description") or ()
    # bash separates `name=` into two words, and typer leaves the last one out.
    if not incomplete and line.endswith((" =", "\n=")):
        words = (*words, "=")
    return complete_description(words, incomplete, in_quotes=has_open_quote(line))


DescriptionArgument = Annotated[
    list[str] | None,
    typer.Argument(help="The pipeline, in gst-launch's language.", autocompletion=_complete),
]
FileOption = Annotated[
    Path | None, typer.Option("-f", "--file", help="Read the description from a .pipe file, or - (stdin).")
]
SettingsOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A value for ${NAME}.")
]


@dataclass(frozen=True, slots=True)
class Description:
    """A text, its name in errors, and its variables."""

    text: str
    name: str
    variables: dict[str, str]


def join_arguments(arguments: Sequence[str]) -> str:
    """The description of command-line arguments: one is the text, several are joined as in gst-launch.

    Blanks inside an argument and outside double quotes are escaped.
    """
    if len(arguments) == 1:
        return arguments[0]
    return " ".join(BLANK_OR_QUOTED.sub(_escaped, argument) for argument in arguments)


def _escaped(match: re.Match[str]) -> str:
    return "\\ " if match[0] == " " else match[0]


def read_description(
    arguments: Sequence[str] | None, file: Path | None, settings: Sequence[str]
) -> Description:
    """The description of the command line; exits with code 2 if it cannot be read."""
    variables: dict[str, str] = {}
    for setting in settings:
        name, separator, value = setting.partition("=")
        if not separator or not name:
            fail_usage(f"--set takes NAME=VALUE, got {setting!r}")
        variables[name] = value
    if file is None:
        if not arguments:
            fail_usage("give a DESCRIPTION, or a file with -f FILE")
        if len(arguments) == 1 and arguments[0].endswith(".pipe") and "!" not in arguments[0]:
            fail_usage(f"{arguments[0]} is a file of a description, give it with -f {arguments[0]}")
        return Description(join_arguments(arguments), "description", variables)
    if arguments:
        fail_usage("give a DESCRIPTION or a file with -f, not both")
    try:
        if str(file) == STANDARD_INPUT:
            name, data = "standard input", sys.stdin.buffer.read(SIZE_LIMIT + 1)
        else:
            with file.open("rb") as source:
                name, data = str(file), source.read(SIZE_LIMIT + 1)
        if len(data) > SIZE_LIMIT:
            fail_usage(f"{name}: a description has at most {SIZE_LIMIT} bytes")
        # Lines end in \n, as in a text file, and a byte-order mark, as some editors write it, is no text.
        text = io.StringIO(data.decode("utf-8-sig"), newline=None).read()
        return Description(text, name, variables)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        fail_usage(f"cannot read the description {file}: {reason}")


def build_graph(description: Description, *, as_json: bool = False) -> Graph:
    """The graph of a description; exits with code 2 if it is invalid."""
    from streamkit.graph.build import build

    try:
        return build(description.text, description.variables)
    except DescriptionError as error:
        fail_description(error, description, as_json=as_json)


def fail_description(error: DescriptionError, description: Description, *, as_json: bool = False) -> NoReturn:
    """Exits because of an invalid description; points into the text, or names the place in a JSON object."""
    if as_json:
        typer.echo(json.dumps({"error": error.facts()}), err=True)
    elif prints_json():
        print_line(f"error: {error.message}", error=error.facts())
    else:
        typer.echo(coloured(error.pointed(description.text, description.name)), err=True)
    sys.stderr.flush()
    raise typer.Exit(USAGE_EXIT)
