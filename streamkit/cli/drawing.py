"""Draws a graph for a terminal, Graphviz and Mermaid, optionally with the counters of a run."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from streamkit.cli.description import fail_usage

if TYPE_CHECKING:
    from streamkit.cli.table import Row
    from streamkit.element.base import Element
    from streamkit.element.pad import Pad
    from streamkit.graph.graph import Graph

SIZE_LIMIT = 50_000_000
SVG_LIMIT_S = 30


@dataclass(frozen=True, slots=True)
class Notes:
    """Counters of a run in a drawing.

    Attributes:
        elements: lines for an element, by `id`.
        links: lines for a link, by the `id` of its sink pad.
        busy: share of time that an element worked, 0 to 1, by `id`.
    """

    elements: dict[int, list[str]] = field(default_factory=dict)
    links: dict[int, list[str]] = field(default_factory=dict)
    busy: dict[int, float] = field(default_factory=dict)


def link_caps(src: Pad, sink: Pad) -> str:
    """The common caps of two pads, as known before data flows."""
    return str(sink.query_caps() & src.query_caps())


def read_notes(built: Graph, file: Path | None) -> Notes:
    """Reads the counters of `launch --stats-file` for the elements of a graph; exits with 2 if invalid."""
    if file is None:
        return Notes()
    import msgspec

    from streamkit.cli.table import measure_rows
    from streamkit.graph.statistics import RunStatistics

    try:
        if file.stat().st_size > SIZE_LIMIT:
            fail_usage(f"{file}: statistics have at most {SIZE_LIMIT} bytes")
        statistics = msgspec.json.decode(file.read_bytes(), type=RunStatistics)
    except OSError as error:
        fail_usage(f"cannot read the statistics {file}: {error.strerror}")
    except msgspec.DecodeError as error:
        fail_usage(f"{file}: no statistics as launch --stats-file writes them: {error}")
    rows = {(row.counters.parent, row.counters.element): row for row in measure_rows(statistics)}
    if not any((element.parent, element.name) in rows for element in built.elements):
        fail_usage(f"{file}: none of its elements is in this description; give the one that was run")
    notes = Notes()
    for element in built.elements:
        if (row := rows.get((element.parent, element.name))) is not None:
            _note(notes, element, row, statistics.elapsed_s)
    return notes


def _note(notes: Notes, element: Element, row: Row, elapsed_s: float) -> None:
    from streamkit.cli.table import facts

    found = facts(row)
    notes.busy[id(element)] = 0.0 if "queue" in found else row.busy
    lines = [f"{name} {found[name]}" for name in ("queue", "busy", "errors", "age") if name in found]
    frames = {pad.pad: pad.frames for pad in row.counters.pads}
    dropped = [f"dropped {found['dropped']}"] if "dropped" in found else []
    for pad in element.sink_pads():
        count = frames.get(pad.name, 0)
        rate = f", {count / elapsed_s:.1f}/s" if elapsed_s > 0 else ""
        notes.links[id(pad)] = [f"{count} frames{rate}", *dropped]
        dropped = []
    notes.elements[id(element)] = lines + dropped


def _ids(built: Graph) -> dict[int, str]:
    """Names of elements in a drawing, numbered if bins share one."""
    taken: Counter[str] = Counter()
    found = {}
    for element in built.elements:
        taken[element.name] += 1
        number = taken[element.name]
        found[id(element)] = element.name if number == 1 else f"{element.name} ({number})"
    return found


def _label(element: Element, notes: Notes) -> str:
    settings = [f"{name}={value}" for name, value in element.properties_set().items()]
    return "\n".join([element.name, *settings, *notes.elements.get(id(element), ())])


def _link_label(src: Pad, sink: Pad, notes: Notes) -> str:
    return "\n".join([link_caps(src, sink), *notes.links.get(id(sink), ())])


def _colour(busy: float) -> str:
    """From white, idle, to orange, fully busy."""
    return f"#ff{round(255 - 90 * busy):02x}{round(255 - 255 * busy):02x}"


def as_dot(built: Graph, notes: Notes) -> str:
    """The graph in Graphviz's language."""

    def quoted(text: str) -> str:
        return json.dumps(text).replace("\\\\n", "\\n")

    ids = _ids(built)
    lines = ["digraph pipeline {", "  rankdir=LR;", "  node [shape=box, fontname=sans];"]
    for element in built.elements:
        share = notes.busy.get(id(element))
        colour = "" if share is None else f', style=filled, fillcolor="{_colour(share)}"'
        lines.append(f"  {quoted(ids[id(element)])} [label={quoted(_label(element, notes))}{colour}];")
    for src, sink in built.links():
        ends = f"{quoted(ids[id(src.element)])} -> {quoted(ids[id(sink.element)])}"
        lines.append(f"  {ends} [label={quoted(_link_label(src, sink, notes))}];")
    return "\n".join([*lines, "}"])


def as_mermaid(built: Graph, notes: Notes) -> str:
    """The graph in Mermaid's language."""
    ids = {id(element): f"n{index}" for index, element in enumerate(built.elements)}

    def text(words: str) -> str:
        return words.replace('"', "#quot;").replace("\n", "<br>")

    lines = ["flowchart LR"]
    lines += [f'  {ids[id(element)]}["{text(_label(element, notes))}"]' for element in built.elements]
    for src, sink in built.links():
        label = text(_link_label(src, sink, notes))
        lines.append(f'  {ids[id(src.element)]} -- "{label}" --> {ids[id(sink.element)]}')
    lines += [f"  style {ids[key]} fill:{_colour(share)}" for key, share in notes.busy.items()]
    return "\n".join(lines)


def as_text(built: Graph, notes: Notes) -> str:
    """The graph for a terminal: each element with its settings, then its links with their caps."""
    ids, lines = _ids(built), list[str]()
    for element in built.elements:
        _, *more = _label(element, notes).splitlines()
        kind = "" if element.name.startswith(element.factory) else f" ({element.factory})"
        lines.append("  ".join([ids[id(element)] + kind, *more]))
        for src, sink in built.links():
            if src.element is element:
                label = _link_label(src, sink, notes).replace("\n", ", ")
                lines.append(f"  {src.name} -> {ids[id(sink.element)]}.{sink.name}  {label}")
    return "\n".join(lines)


def as_svg(built: Graph, notes: Notes) -> str:
    """The graph as SVG; needs Graphviz's `dot`."""
    dot = shutil.which("dot")
    if dot is None:
        fail_usage("svg needs the program dot of Graphviz; install Graphviz, or use --format mermaid")
    drawn = subprocess.run(
        [dot, "-Tsvg"],
        input=as_dot(built, notes),
        capture_output=True,
        text=True,
        timeout=SVG_LIMIT_S,
        check=False,
    )
    if drawn.returncode:
        fail_usage(f"dot could not draw the graph: {drawn.stderr.strip()[:300]}")
    return drawn.stdout
