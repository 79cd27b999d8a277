"""What a process of a graph costs: processor time, memory, and frames that cross to other processes."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from pathlib import Path

from streamkit.graph.graph import Graph
from streamkit.graph.processes.process_link import ProcessLink
from streamkit.graph.statistics import ElementStatistics, ProcessStatistics

MAIN = "main"


def measure_process(graph: Graph, rows: Iterable[ElementStatistics], cpu_began_ns: int) -> ProcessStatistics:
    """The counters of the calling process.

    Args:
        graph: the whole graph.
        rows: the counters of its elements in this process, in order.
        cpu_began_ns: processor time that the process had used when streaming began, ns.
    """
    frames = crossings = waited_ns = 0
    for element, row in zip(graph.elements, rows, strict=True):
        if not graph.is_local(element):
            continue
        frames = max(frames, row.frames_in, row.frames_out)
        if isinstance(element, ProcessLink):
            crossings += row.frames_in if element.writes else row.frames_out
            waited_ns += element.waited_ns
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
