"""Counters of a graph of which parts run in other processes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msgspec import structs

from streamkit.graph.bins import Bin
from streamkit.graph.graph import Graph
from streamkit.graph.processes.part import Part
from streamkit.graph.processes.process_link import ProcessLink
from streamkit.graph.statistics import ElementStatistics

LOST = "lost with the process that had them"


def merge_statistics(
    graph: Graph, own: list[ElementStatistics], parts: Iterable[Part], lost: Mapping[ProcessLink, int]
) -> list[ElementStatistics]:
    """Replaces the rows of elements by those of the processes that run them.

    Args:
        graph: the whole graph.
        own: a row for each of its elements, from the main process.
        parts: the other processes.
        lost: by link, frames on the way through connections that were replaced.

    Returns:
        The rows; messages are counted by the main process. A process link has what its writing half took in
        and its reading half sent on.
    """
    reported = {part.home: part.statistics() for part in parts}

    def row(index: int, mine: ElementStatistics) -> ElementStatistics:
        element = graph.elements[index]

        def of(home: Bin | None) -> ElementStatistics:
            return mine if home is None else _at(reported[home], index, mine)

        if not isinstance(element, ProcessLink):
            home = graph.homes.get(element)
            return structs.replace(of(home), errors=mine.errors, warnings=mine.warnings)
        first, last = map(of, graph.process_links[element])
        pads = [first.pads[0], last.pads[1]]
        dropped = mine.dropped | ({LOST: lost[element]} if lost.get(element) else {})
        return structs.replace(
            mine, frames_in=first.frames_in, frames_out=last.frames_out, busy_ns=first.busy_ns,
            age_ns=last.age_ns, pads=pads, dropped=dropped,
        )  # fmt: skip

    return [row(index, mine) for index, mine in enumerate(own)]


def _at(rows: list[ElementStatistics], index: int, default: ElementStatistics) -> ElementStatistics:
    """The row of an element; a process that has not answered yet has none."""
    return rows[index] if index < len(rows) else default
