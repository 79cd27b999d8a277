"""`launch --processes auto`: runs a pipeline for some seconds, and cuts it into processes of like work."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from bisect import bisect_right
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from streamkit.cli.description import Description
from streamkit.cli.stderr import print_line
from streamkit.graph.parse import ElementNode, parse
from streamkit.handoff.library_threads import available_cores
from streamkit.masking import mask_secrets

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.errors import Place
    from streamkit.flow.statistics import ElementStatistics
    from streamkit.graph.graph import Graph
    from streamkit.graph.pipeline import Pipeline

MEASURE_S, SETTLE_S = 5.0, 1.0  # the second is part of the first
MIN_GAIN = 0.1  # of the time of a frame: a process takes about 120 MiB, and times vary by some percent
CROSSING_NS = 150_000  # of a 1080p frame, in each of two processes; see benchmarks/process_bins.py
RAW_VIDEO = "video/x-raw"  # side data of packets does not cross


def choose_processes(source: Description, pipeline: Pipeline) -> Description:
    """Measures a pipeline, and prints the description that uses the cores best; raises `ElementFailure`."""
    found = with_processes(source, pipeline)
    text = "one process is best" if found is source else mask_secrets(found.text.strip())
    print_line(f"note: --processes auto: {text}")
    return found


def with_processes(source: Description, pipeline: Pipeline) -> Description:
    """The description with bins in processes, so that the cores have like work.

    Only the first chain is cut, at links of raw video; what follows the last cut stays in the main process.

    Args:
        source: the description as written.
        pipeline: built from it; it is run for some seconds without its sinks and writes nothing.

    Raises:
        ElementFailure: it fails in this time.
    """
    chain = parse(source.text, source.variables)[0]
    nodes = [node for node in chain.nodes if isinstance(node, ElementNode)]
    if pipeline.graph.processes or len(nodes) < len(chain.nodes):
        return source
    heads = [head.name for head in pipeline.graph.elements[: len(nodes)]]
    work, allowed, frames, present = measure(pipeline, heads)
    cuts = balanced_cuts(work, allowed, available_cores(), frames * CROSSING_NS, present)
    if not cuts:
        return source
    starts = [nodes[number].place for number in (0, *cuts[:-1])]
    ends = [chain.links[number - 1].place for number in cuts]
    return dataclasses.replace(source, text=_bracketed(source.text, starts, ends))


def measure(pipeline: Pipeline, heads: list[str]) -> tuple[list[float], list[int], int, float]:
    """Runs a pipeline for some seconds, without its sinks.

    Args:
        pipeline: its graph is changed.
        heads: names of the elements that begin the parts of its first chain.

    Returns:
        The working time of each part, ns, numbers of the parts before which it may be cut, frames, and the
        time that these take as it is, ns; 0 if it is live and has dropped nothing.
    """
    graph = pipeline.graph
    leave_out_sinks(graph)
    for element in graph.elements:
        if "threads" in element.properties:
            element.set_property("threads", 1)  # work in threads of its own is not in its working time
    pipeline.play()
    try:
        message, began = pipeline.wait(SETTLE_S), _progress(pipeline, heads)
        message = message or pipeline.wait(MEASURE_S - SETTLE_S)
        if message is not None and message.error is not None:
            raise message.error
        ended, rows = _progress(pipeline, heads), {row.element: row for row in pipeline.statistics()}
        ordered = list(reversed(graph.from_sinks()))  # the stream may have brought links
        begins = [ordered.index(graph.element(head)) for head in heads]
        allowed = [number for number, begin in enumerate(begins) if _is_raw_video(graph, ordered[:begin])]
    finally:
        pipeline.stop()
    work = _work_of_parts([rows[element.name] for element in ordered], begins)
    frames = max((rows[heads[number]].frames_in for number in allowed), default=0)
    spent, through, dropped = (after - before for after, before in zip(ended, began, strict=True))
    present = spent / through * frames if through else math.inf
    is_fast_enough = pipeline.is_live and through and not dropped
    return work, allowed, frames, 0.0 if is_fast_enough else present


def _work_of_parts(rows: list[ElementStatistics], begins: list[int]) -> list[float]:
    """The work of the parts that begin at some of the elements in order, with what queues have dropped."""
    work, passed = [0.0] * len(begins), 1.0
    for index, row in enumerate(rows):
        if row.queue is None:
            work[max(0, bisect_right(begins, index) - 1)] += row.busy_ns / passed
        elif row.total_dropped < row.frames_in:
            passed *= 1 - row.total_dropped / row.frames_in
    return work


def _progress(pipeline: Pipeline, heads: list[str]) -> tuple[int, int, int]:
    """The time, ns, the frames of the part that has had least, and how many were dropped anywhere."""
    rows = pipeline.statistics()
    frames = (row.frames_in for row in rows if row.element in heads[1:])
    return time.perf_counter_ns(), min(frames, default=0), sum(row.total_dropped for row in rows)


def leave_out_sinks(graph: Graph) -> None:
    """Puts a `fakesink` in the place of each sink, and lets no other element write a file."""
    from streamkit.element.registry import make_element
    from streamkit.element.sink import Sink

    for index, element in enumerate(graph.elements):
        for declaration in element.properties.values():
            if declaration.file == "write":
                setattr(element, declaration.attribute, declaration.default)
        if isinstance(element, Sink) and element.factory != "fakesink":
            substitute = graph.elements[index] = make_element("fakesink", element.name)
            for pad in element.sink_pads():
                if (src := pad.peer) is not None:
                    src.unlink()
                    src.link(substitute.pads["sink"])


def _is_raw_video(graph: Graph, before: list[Element]) -> bool:
    """Whether all that leaves some elements is raw video, through one link."""
    sources = [src for src, sink in graph.links() if src.element in before and sink.element not in before]
    waiting = any(
        (link.request.source in before) is not (link.request.sink in before) for link in graph.delayed_links
    )
    return not waiting and len(sources) == 1 and str(sources[0].caps).startswith(RAW_VIDEO)


def balanced_cuts(
    work: Sequence[float], cuts: Collection[int], cores: int, crossing: float, present: float = math.inf
) -> list[int]:
    """The places at which to cut a chain, such that the busiest process has least to do.

    Args:
        work: of each part of the chain, in order.
        cuts: numbers of the parts before which it may be cut.
        cores: largest number of processes.
        crossing: what a cut costs each of the two processes, in the unit of `work`.
        present: what all of it takes uncut, in threads of its own, likewise.

    Returns:
        Some of `cuts`, in order; none if that would save less than a tenth of `present`, or of all work.
    """

    @functools.cache
    def split(first: int, processes: int) -> tuple[float, int, tuple[int, ...]]:
        """The work of the busiest process from a part on, and the number and places of the cuts."""
        before = crossing if first else 0.0
        found: list[tuple[float, int, tuple[int, ...]]] = [(before + sum(work[first:]), 0, ())]
        for place in (place for place in cuts if processes > 1 and place > first):
            most, count, places = split(place, processes - 1)
            most = max(most, before + sum(work[first:place]) + crossing)
            found.append((most, count + 1, (place, *places)))
        return min(found)

    most, _, places = split(0, cores)
    return list(places) if most <= (1 - MIN_GAIN) * min(sum(work), present) else []


def _bracketed(text: str, starts: list[Place], ends: list[Place]) -> str:
    """The text with a bin with a process from each start to the end of the same index."""
    lines = text.splitlines(keepends=True)

    def offset(place: Place) -> int:
        return sum(map(len, lines[: place.line - 1])) + place.column - 1

    inserted = [(offset(place), "( process=true ") for place in starts]
    inserted += [(offset(place), ") ") for place in ends]
    for at, words in sorted(inserted, reverse=True):
        text = text[:at] + words + text[at:]
    return text
