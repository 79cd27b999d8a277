"""`streamkit graph`: builds a pipeline without running it and draws it."""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from streamkit.cli.description import (
    DescriptionArgument,
    FileOption,
    SettingsOption,
    fail_description,
    read_description,
)
from streamkit.cli.drawing import Counters, as_dot, as_mermaid, as_svg, as_text, link_caps
from streamkit.cli.stderr import fail_usage, print_line
from streamkit.cli.table import measure_rows
from streamkit.errors import DescriptionError, StreamError
from streamkit.graph.description_text import unused_variables
from streamkit.masking import mask_secrets, presentable_value

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.graph.graph import Graph


GraphFormat = Literal["json", "dot", "mermaid", "text", "svg"]


def graph(
    description: DescriptionArgument = None,
    file: FileOption = None,
    settings: SettingsOption = None,
    form: Annotated[
        GraphFormat | None,
        typer.Option("--format", help="Output format; without it text on a terminal, else mermaid."),
    ] = None,
    stats: Annotated[
        Path | None,
        typer.Option("--stats", help="Add the counters of a run, from a file of launch --stats-file."),
    ] = None,
) -> None:
    """Builds a pipeline without running it and draws it: elements, links, caps, inserted converters."""
    from streamkit.graph.build import build
    from streamkit.graph.negotiate import remembered_caps

    form = form or ("text" if sys.stdout.isatty() else "mermaid")
    source = read_description(description, file, settings or [])
    try:
        built = build(source.text, source.variables)
    except DescriptionError as error:
        fail_description(error, source, as_json=form == "json")
    for note in unused_variables(source.text, source.variables):
        print_line(f"note: {note}")
    draw = {"dot": as_dot, "mermaid": as_mermaid, "svg": as_svg, "text": as_text}
    with contextlib.nullcontext() if built.has_loop() else remembered_caps(built):
        if form == "json":
            drawn = json.dumps(presentable_value(as_json(built), mask_secrets), indent=2)
        else:
            drawn = draw[form](built, _read_counters(built, stats))
    typer.echo(drawn)


def _read_counters(built: Graph, file: Path | None) -> Counters:
    """Reads the counters of `launch --stats-file` for the elements of a graph; exits with 2 if invalid."""
    if file is None:
        return Counters()
    from streamkit.flow.statistics import read_statistics

    try:
        statistics = read_statistics(file)
    except StreamError as error:
        fail_usage(str(error))
    except OSError as error:
        fail_usage(f"cannot read the statistics {file}: {error.strerror}")
    by_name = {(row.counters.parent, row.counters.element): row for row in measure_rows(statistics)}
    names = {element: (element.parent, element.name) for element in built.elements}
    rows = {element: by_name[name] for element, name in names.items() if name in by_name}
    if not rows:
        fail_usage(f"{file}: none of its elements is in this description; give the one that was run")
    return Counters(rows, statistics.elapsed_s)


def as_json(built: Graph) -> dict[str, Any]:
    """The graph as a JSON object; inserted converters are under `inserted`.

    If there are any, a bin has `ghost_pads`, and the object `delayed_links`, which wait for their pad.
    """
    found: dict[str, Any] = {
        "elements": [
            *(_described(element) for element in built.elements if element not in built.inserted),
            *(
                {**_described(group), **({"ghost_pads": group.ghost_pads} if group.ghost_pads else {})}
                for group in built.bins
            ),
        ],
        "inserted": [_described(element) for element in built.inserted],
        "links": [
            {"src": src.path, "sink": sink.path, "caps": link_caps(src, sink)} for src, sink in built.links()
        ],
        "warnings": [{"code": code, "message": text} for code, text in built.warnings],
    }
    if built.delayed_links:
        found["delayed_links"] = [link.description for link in built.delayed_links]
    return found


def _described(element: Element) -> dict[str, Any]:
    return {
        "name": element.name,
        "factory": element.factory,
        "parent": element.parent or None,
        "properties": element.properties_set(),
    }
