"""Counters of a graph of which parts run in other processes, and what each process costs."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path

from msgspec import structs

from streamkit.element.base import Element
from streamkit.flow.statistics import ElementStatistics, ProcessStatistics
from streamkit.graph.bins import Bin
from streamkit.graph.graph import Graph
from streamkit.graph.processes.process_link import LOST, ProcessLink

MAIN = "main"


def merge_statistics(
    graph: Graph,
    own: Mapping[Element, ElementStatistics],
    reported: Mapping[Bin, Mapping[Element, ElementStatistics]],
) -> list[ElementStatistics]:
    """Replaces the rows of elements by those of the processes that run them.

    Args:
        graph: the whole graph.
        own: a row for each element, from the main process, which counts all messages.
        reported: the same from the other processes; empty before the first answer.

    Returns:
        The rows. A process link has what its writing half took in and its reading half sent on.
    """

    def row(element: Element, mine: ElementStatistics) -> ElementStatistics:
        def of(home: Bin | None) -> ElementStatistics:
            return mine if home is None else reported[home].get(element, mine)

        if not isinstance(element, ProcessLink):
            return structs.replace(of(graph.homes.get(element)), errors=mine.errors, warnings=mine.warnings)
        first, last = map(of, graph.process_links[element])
        lost = element.lost()
        return structs.replace(
            mine, frames_in=first.frames_in, frames_out=last.frames_out, busy_ns=first.busy_ns,
            age_ns=last.age_ns, pads=[first.pads[0], last.pads[1]],
            dropped=mine.dropped | ({LOST: lost} if lost else {}),
        )  # fmt: skip

    return [row(element, mine) for element, mine in own.items()]


def measure_process(
    graph: Graph, rows: Mapping[Element, ElementStatistics], cpu_began_ns: int
) -> ProcessStatistics:
    """The counters of the calling process.

    Args:
        graph: the whole graph.
        rows: the counters of its elements in this process.
        cpu_began_ns: processor time that the process had used when streaming began, ns.
    """
    frames = crossings = waited_ns = 0
    for element, row in rows.items():
        if not graph.is_local(element):
            continue
        frames = max(frames, row.frames_in, row.frames_out)
        if isinstance(element, ProcessLink):
            crossings += row.frames_in if element.writes else row.frames_out
            waited_ns += element.link_wait_ns
    return ProcessStatistics(
        process=MAIN if graph.here is None else graph.here.name,
        pid=os.getpid(),
        cpu_ns=time.process_time_ns() - cpu_began_ns,
        rss_bytes=resident_bytes(),
        frames=frames,
        crossings=crossings,
        waited_ns=waited_ns,
    )


def resident_bytes() -> int:
    """Memory of this process that is in RAM, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
