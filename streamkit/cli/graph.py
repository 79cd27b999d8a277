"""`streamkit graph`: builds a pipeline without running it and draws it."""

from __future__ import annotations

import enum
import json
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
    from streamkit.element.pad import Pad
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
    """The graph as DESIGN's JSON object; converters put in stand under `inserted`."""
    inserted = {element.name for element in built.inserted}

    def describe(element: Any) -> dict[str, Any]:
        settings: dict[str, Any] = element.settings() if hasattr(element, "settings") else {}
        return {
            "name": element.name,
            "factory": element.factory,
            "parent": element.parent or None,
            "properties": settings,
        }

    return {
        "elements": [
            *(describe(element) for element in built.elements if element.name not in inserted),
            *(describe(group) for group in built.bins),
        ],
        "inserted": [describe(element) for element in built.inserted],
        "links": [
            {"src": src.path, "sink": sink.path, "caps": link_caps(src, sink)} for src, sink in built.links()
        ],
        "warnings": [{"code": code, "message": text} for code, text in built.warnings],
    }


def _label(element: Any) -> str:
    settings = [f"{name}={value}" for name, value in element.settings().items()]
    return "\n".join([element.name, *settings])


def as_dot(built: Graph) -> str:
    """The graph in Graphviz's language."""

    def quoted(text: str) -> str:
        return json.dumps(text).replace("\\\\n", "\\n")

    lines = ["digraph pipeline {", "  rankdir=LR;", "  node [shape=box, fontname=sans];"]
    lines += [f"  {quoted(element.name)} [label={quoted(_label(element))}];" for element in built.elements]
    for src, sink in built.links():
        ends = f"{quoted(src.element.name)} -> {quoted(sink.element.name)}"
        lines.append(f"  {ends} [label={quoted(link_caps(src, sink))}];")
    return "\n".join([*lines, "}"])


def as_mermaid(built: Graph) -> str:
    """The graph in Mermaid's language."""
    ids = {element.name: f"n{index}" for index, element in enumerate(built.elements)}

    def text(words: str) -> str:
        return words.replace('"', "#quot;").replace("\n", "<br>")

    lines = ["flowchart LR"]
    lines += [f'  {ids[element.name]}["{text(_label(element))}"]' for element in built.elements]
    for src, sink in built.links():
        caps = text(link_caps(src, sink))
        lines.append(f'  {ids[src.element.name]} -- "{caps}" --> {ids[sink.element.name]}')
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
