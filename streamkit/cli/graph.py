"""`streamkit graph`: builds a pipeline without running it and draws it."""

from __future__ import annotations

import enum
import json
from collections import Counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from streamkit.cli.description import (
    DescriptionArgument,
    FileOption,
    SettingsOption,
    fail_description,
    fail_usage,
    read_description,
)
from streamkit.errors import DescriptionError

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.element.pad import Pad
    from streamkit.graph.bins import Bin
    from streamkit.graph.graph import Graph


class GraphFormat(enum.StrEnum):
    """How a graph is drawn."""

    JSON = "json"
    DOT = "dot"
    MERMAID = "mermaid"
    SVG = "svg"


def graph(
    description: DescriptionArgument = None,
    file: FileOption = None,
    settings: SettingsOption = None,
    form: Annotated[GraphFormat, typer.Option("--format", help="How to draw it.")] = GraphFormat.MERMAID,
) -> None:
    """Builds a pipeline without running it and draws it: elements, links, caps, converters put in."""
    from streamkit.graph.build import build
    from streamkit.graph.negotiate import remembered_caps

    source = read_description(description, file, settings or [])
    try:
        built = build(source.text, source.variables)
    except DescriptionError as error:
        fail_description(error, source, as_json=form is GraphFormat.JSON)
    draw = {GraphFormat.DOT: as_dot, GraphFormat.MERMAID: as_mermaid, GraphFormat.SVG: as_svg}
    with remembered_caps(built):
        drawn = json.dumps(as_json(built), indent=2) if form is GraphFormat.JSON else draw[form](built)
    typer.echo(drawn)


def link_caps(src: Pad, sink: Pad) -> str:
    """The caps two pads can agree on, as far as is known before data flows."""
    return str(sink.query_caps() & src.query_caps())


def as_json(built: Graph) -> dict[str, Any]:
    """The graph as DESIGN's JSON object; converters put in stand under `inserted`.

    Where there are any, a bin has `ghost_pads`, and the object `delayed_links`, which wait for their pad.
    """
    inserted = {id(element) for element in built.inserted}
    found: dict[str, Any] = {
        "elements": [
            *(_described(element) for element in built.elements if id(element) not in inserted),
            *({**_described(group), **_ghost_pads(group)} for group in built.bins),
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
        "properties": element.settings(),
    }


def _ghost_pads(group: Bin) -> dict[str, dict[str, str]]:
    return {"ghost_pads": group.ghost_pads} if group.ghost_pads else {}


def _ids(built: Graph) -> dict[int, str]:
    """What each element is called in a drawing: its name, with a number where bins share one."""
    taken: Counter[str] = Counter()
    found = {}
    for element in built.elements:
        taken[element.name] += 1
        number = taken[element.name]
        found[id(element)] = element.name if number == 1 else f"{element.name} ({number})"
    return found


def _label(element: Any) -> str:
    settings = [f"{name}={value}" for name, value in element.settings().items()]
    return "\n".join([element.name, *settings])


def as_dot(built: Graph) -> str:
    """The graph in Graphviz's language."""

    def quoted(text: str) -> str:
        return json.dumps(text).replace("\\\\n", "\\n")

    ids = _ids(built)
    lines = ["digraph pipeline {", "  rankdir=LR;", "  node [shape=box, fontname=sans];"]
    lines += [
        f"  {quoted(ids[id(element)])} [label={quoted(_label(element))}];" for element in built.elements
    ]
    for src, sink in built.links():
        ends = f"{quoted(ids[id(src.element)])} -> {quoted(ids[id(sink.element)])}"
        lines.append(f"  {ends} [label={quoted(link_caps(src, sink))}];")
    return "\n".join([*lines, "}"])


def as_mermaid(built: Graph) -> str:
    """The graph in Mermaid's language."""
    ids = {id(element): f"n{index}" for index, element in enumerate(built.elements)}

    def text(words: str) -> str:
        return words.replace('"', "#quot;").replace("\n", "<br>")

    lines = ["flowchart LR"]
    lines += [f'  {ids[id(element)]}["{text(_label(element))}"]' for element in built.elements]
    for src, sink in built.links():
        caps = text(link_caps(src, sink))
        lines.append(f'  {ids[id(src.element)]} -- "{caps}" --> {ids[id(sink.element)]}')
    return "\n".join(lines)


def as_svg(built: Graph) -> str:
    """The graph as a picture, drawn by Graphviz where its `dot` is installed."""
    import shutil
    import subprocess

    dot = shutil.which("dot")
    if dot is None:
        fail_usage("svg needs the program dot of Graphviz; install Graphviz, or use --format mermaid")
    drawn = subprocess.run(
        [dot, "-Tsvg"], input=as_dot(built), capture_output=True, text=True, timeout=30, check=False
    )
    if drawn.returncode:
        fail_usage(f"dot could not draw the graph: {drawn.stderr.strip()[:300]}")
    return drawn.stdout
