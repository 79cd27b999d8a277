"""What a pipeline is asked of its graph: latency, position and duration."""

from __future__ import annotations

from dataclasses import dataclass

from streamkit.element.base import Element
from streamkit.element.sink import Sink
from streamkit.element.source import Source
from streamkit.graph.graph import Graph


@dataclass(frozen=True, slots=True)
class Latency:
    """Latency of the slowest path, and the shortest time that any can buffer frames (None: any time), ns.

    Without a live source both are 0.
    """

    is_live: bool
    minimum_ns: int = 0
    maximum_ns: int | None = None

    def warning(self) -> str:
        """A warning if paths cannot buffer frames for the minimum latency, else ""."""
        if self.maximum_ns is None or self.maximum_ns >= self.minimum_ns:
            return ""
        return (
            f"live frames need {self.minimum_ns / 1e6:g} ms to reach the sinks in time, but can be held "
            f"for {self.maximum_ns / 1e6:g} ms only: put a queue before the synchronised sink"
        )


def graph_latency(graph: Graph) -> Latency:
    """The latency of a graph: maximum of all paths, and the minimum that any of them can buffer.

    Source: GStreamer's latency query.
    """
    if not graph.is_live:
        return Latency(False)
    known: dict[Element, Latency] = {}
    for element in reversed(graph.from_sinks()):
        upstream = _joined([known[before] for before in element.upstream()])
        minimum_ns, maximum_ns = element.latency()
        is_live = upstream.is_live or (isinstance(element, Source) and bool(element.is_live))
        known[element] = Latency(
            is_live,
            upstream.minimum_ns + minimum_ns,
            None if upstream.maximum_ns is None or maximum_ns is None else upstream.maximum_ns + maximum_ns,
        )
    ends = [known[element] for element in graph.elements if isinstance(element, Sink)]
    return _joined([end for end in ends if end.is_live] or ends)


def _joined(paths: list[Latency]) -> Latency:
    bounds = [path.maximum_ns for path in paths if path.maximum_ns is not None]
    return Latency(
        any(path.is_live for path in paths),
        max((path.minimum_ns for path in paths), default=0),
        min(bounds) if bounds else (None if paths else 0),
    )


def newest_position_ns(graph: Graph) -> int | None:
    """Timestamp of the newest frame that a sink with `sync` has rendered, else that a source has sent."""
    for kind in (Sink, Source):
        found = [element.position_ns for element in graph.elements if isinstance(element, kind)]
        if newest := [position for position in found if position is not None]:
            return max(newest)
    return None


def longest_duration_ns(graph: Graph) -> int | None:
    """Duration of the longest source; None if that of any source is unknown."""
    durations = [element.duration_ns() for element in graph.elements if isinstance(element, Source)]
    known = [duration for duration in durations if duration is not None]
    return max(known) if known and len(known) == len(durations) else None
