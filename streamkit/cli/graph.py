"""`streamkit graph`: builds a pipeline without running it and draws it, also with the counters of a run."""

from __future__ import annotations

import contextlib
import json
import shutil
import sys
import textwrap
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from streamkit.cli.description import (
    DescriptionArgument,
    FileOption,
    SettingsOption,
    build_graph,
    read_description,
)
from streamkit.cli.layered_svg import Arrow, Box, draw_svg
from streamkit.cli.stderr import fail_usage, print_line
from streamkit.cli.summary import Row, facts, measure_rows
from streamkit.errors import StreamError
from streamkit.graph.description_text import unused_variables
from streamkit.masking import mask_secrets, presentable_value

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.element.pad import Pad
    from streamkit.graph.graph import Graph

SVG_COLUMNS = 50
MIN_CAPS_COLUMNS = 20  # columns
DRAWN_FORMATS = 3  # in the label of a link; the file sources alone have two dozen
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
    from streamkit.graph.negotiate import remembered_caps

    form = form or ("text" if sys.stdout.isatty() else "mermaid")
    source = read_description(description, file, settings or [])
    built = build_graph(source, as_json=form == "json")
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


@dataclass(frozen=True, slots=True)
class Counters:
    """Counters of a run, in a drawing: of the elements, and the length of the run, s."""

    rows: dict[Element, Row] = field(default_factory=dict)
    elapsed_s: float = 0.0


def link_caps(src: Pad, sink: Pad) -> str:
    """The common caps of two pads, as known before data flows."""
    return str(sink.query_caps() & src.query_caps())


def _ids(built: Graph) -> dict[Element, str]:
    """Names of elements in a drawing, numbered if bins share one."""
    taken: Counter[str] = Counter()
    found = {}
    for element in built.elements:
        taken[element.name] += 1
        number = taken[element.name]
        found[element] = element.name if number == 1 else f"{element.name} ({number})"
    return found


def _title(element: Element, ids: dict[Element, str]) -> str:
    """The element's name in a drawing, with its factory where that does not show."""
    kind = "" if element.name.startswith(element.factory) else f" ({element.factory})"
    return ids[element] + kind


def _details(element: Element, counters: Counters) -> list[str]:
    """Settings and counters of an element, a line each; drops stand at its first link."""
    lines = [f"{name}={value}" for name, value in element.properties_set().items()]
    if (row := counters.rows.get(element)) is not None:
        found = facts(row)
        names = ("queue", "busy", "errors", "age") + (() if any(element.sink_pads()) else ("dropped",))
        lines += [f"{name} {found[name]}" for name in names if name in found]
    return "\n".join(lines).splitlines()


def _link_details(src: Pad, sink: Pad, counters: Counters) -> list[str]:
    """The first formats, frames, rate and drops of a link, a line each."""
    formats = link_caps(src, sink).split("; ")
    more = len(formats) - DRAWN_FORMATS
    rest = [f"... and {more} more"] if more > 0 else []
    return [*formats[:DRAWN_FORMATS], *rest, *_link_counts(sink, counters)]


def _link_counts(sink: Pad, counters: Counters) -> list[str]:
    lines = []
    if (row := counters.rows.get(sink.element)) is not None:
        count = next((pad.frames for pad in row.counters.pads if pad.pad == sink.name), 0)
        rate = f", {count / counters.elapsed_s:.1f}/s" if counters.elapsed_s > 0 else ""
        lines.append(f"{count} frames{rate}")
        if sink is next(sink.element.sink_pads()) and (dropped := facts(row).get("dropped")):
            lines.append(f"dropped {dropped}")
    return lines


def _colours(built: Graph, counters: Counters) -> dict[Element, str]:
    """Colours of elements, from white, idle, to orange, fully busy; a queue is never busy."""
    found = {}
    for element in built.elements:
        if (row := counters.rows.get(element)) is not None:
            busy = 0.0 if row.counters.queue is not None else row.busy
            found[element] = f"#ff{round(255 - 90 * busy):02x}{round(255 - 255 * busy):02x}"
    return found


def as_dot(built: Graph, counters: Counters) -> str:
    """The graph in Graphviz's language."""

    def quoted(*lines: str) -> str:
        return json.dumps("\n".join(lines)).replace("\\\\n", "\\n")

    ids, colours = _ids(built), _colours(built, counters)
    lines = ["digraph pipeline {", "  rankdir=LR;", "  node [shape=box, fontname=sans];"]
    for element in built.elements:
        colour = f', style=filled, fillcolor="{colours[element]}"' if element in colours else ""
        label = quoted(element.name, *_details(element, counters))
        lines.append(f"  {quoted(ids[element])} [label={label}{colour}];")
    for src, sink in built.links():
        ends = f"{quoted(ids[src.element])} -> {quoted(ids[sink.element])}"
        lines.append(f"  {ends} [label={quoted(*_link_details(src, sink, counters))}];")
    return "\n".join([*lines, "}"])


def as_mermaid(built: Graph, counters: Counters) -> str:
    """The graph in Mermaid's language."""
    ids = {element: f"n{index}" for index, element in enumerate(built.elements)}

    def text(*lines: str) -> str:
        return "<br>".join(lines).replace('"', "#quot;")

    lines = ["flowchart LR"]
    for element in built.elements:
        lines.append(f'  {ids[element]}["{text(element.name, *_details(element, counters))}"]')
    for src, sink in built.links():
        label = text(*_link_details(src, sink, counters))
        lines.append(f'  {ids[src.element]} -- "{label}" --> {ids[sink.element]}')
    lines += [
        f"  style {ids[element]} fill:{colour}" for element, colour in _colours(built, counters).items()
    ]
    return "\n".join(lines)


def as_text(built: Graph, counters: Counters) -> str:
    """Each element with its settings, then its links with their caps, shortened to fit a terminal."""
    ids, lines = _ids(built), list[str]()
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    for element in built.elements:
        lines.append("  ".join([_title(element, ids), *_details(element, counters)]))
        for src, sink in built.links():
            if src.element is element:
                caps = link_caps(src, sink)
                head = f"  {src.name} -> {ids[sink.element]}.{sink.name}  "
                end = "".join(f", {text}" for text in _link_counts(sink, counters))
                if columns is not None:
                    room = max(columns - len(head) - len(end), MIN_CAPS_COLUMNS)
                    caps = textwrap.shorten(caps, room, placeholder=" ...")
                lines.append(head + caps + end)
    return "\n".join(lines)


def as_svg(built: Graph, counters: Counters) -> str:
    """The graph as SVG, from top to bottom."""
    indices = {element: index for index, element in enumerate(built.elements)}
    ids, colours = _ids(built), _colours(built, counters)
    boxes = []
    for element in built.elements:
        lines = [line[:SVG_COLUMNS] for line in (_title(element, ids), *_details(element, counters))]
        boxes.append(Box(lines, colours.get(element, "white")))
    arrows = []
    for src, sink in built.links():
        lines = _link_details(src, sink, counters)
        wrapped = [part for line in lines for part in textwrap.wrap(line, SVG_COLUMNS)]
        arrows.append(Arrow(indices[src.element], indices[sink.element], wrapped))
    return draw_svg(boxes, arrows)
