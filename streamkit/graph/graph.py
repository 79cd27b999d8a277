"""Graph: elements and the links between them, and what is asked of all of them."""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING

from streamkit.element.base import Element
from streamkit.element.pad import Pad, Presence
from streamkit.element.sink import Sink
from streamkit.element.source import Source
from streamkit.errors import StateError
from streamkit.graph.bins import Bin
from streamkit.graph.processes.process_link import ProcessLink

if TYPE_CHECKING:
    from streamkit.graph.linking import DelayedLink


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


@dataclass(slots=True)
class Graph:
    """Elements and links.

    Attributes:
        elements: in textual order.
        inserted: converters inserted by negotiation; also in `elements`.
        added_branches: the first src pad of each branch of `Pipeline.add_branch`.
        delayed_links: links that wait for sometimes pads.
        warnings: (code, text) pairs.
        text, variables: the description it was built from.
        homes: the bin in whose process an element runs, for those outside the main process.
        process_links: the bins between whose processes each runs, writer first; None is the main process.
        here: the bin whose elements this process runs; None is the main process.
    """

    elements: list[Element] = field(default_factory=list)
    bins: list[Bin] = field(default_factory=list)
    inserted: list[Element] = field(default_factory=list)
    added_branches: set[Pad] = field(default_factory=set)
    delayed_links: list[DelayedLink] = field(default_factory=list)
    warnings: list[tuple[str, str]] = field(default_factory=list)
    text: str = field(default="", repr=False)  # it may hold secrets
    variables: Mapping[str, str] = field(default_factory=dict, repr=False)
    homes: dict[Element, Bin] = field(default_factory=dict)
    process_links: dict[ProcessLink, tuple[Bin | None, Bin | None]] = field(default_factory=dict)
    here: Bin | None = None

    @property
    def processes(self) -> list[Bin]:
        """The bins that run in a process of their own."""
        return list(dict.fromkeys(self.homes.values()))

    @property
    def packages(self) -> set[str]:
        """The top-level packages of the elements, whose metadata may come from other processes."""
        return {type(element).__module__.partition(".")[0] for element in self.elements}

    def run_only(self, home: Bin | None) -> None:
        """Chooses the part of the graph that this process runs."""
        self.here = home
        for link, (writer, reader) in self.process_links.items():
            link.writes, link.reads = writer is home, reader is home

    def local(self) -> list[Element]:
        """The elements that run in this process."""
        return [element for element in self.elements if self.is_local(element)]

    @property
    def is_live(self) -> bool:
        """Whether any source is live, in any process."""
        return any(isinstance(element, Source) and element.is_live for element in self.elements)

    def roots(self) -> list[Element]:
        """The local elements where streams begin: sources, and links from other processes."""
        return [
            element
            for element in self.local()
            if isinstance(element, Source) or (isinstance(element, ProcessLink) and element.reads)
        ]

    def is_local(self, element: Element) -> bool:
        """Whether an element, or half of it, runs in this process."""
        if isinstance(element, ProcessLink):
            return element.writes or element.reads
        return self.homes.get(element) is self.here

    def element(self, name: str) -> Element:
        """The element of a name, or of `bin/name`; raises `KeyError`, which lists all names."""
        for element in self.elements:
            if name in (element.name, f"{element.parent}/{element.name}"):
                return element
        raise KeyError(
            f"no element {name!r} in the pipeline; it has {', '.join(e.name for e in self.elements)}"
        )

    def links(self) -> Iterator[tuple[Pad, Pad]]:
        """All links as (src pad, sink pad), in the order of the elements."""
        for element in self.elements:
            for pad in element.src_pads():
                if pad.peer is not None:
                    yield pad, pad.peer

    def from_sinks(self) -> list[Element]:
        """The elements in reverse topological order: sinks first, sources last; raises `CycleError`."""
        return list(TopologicalSorter({e: e.downstream() for e in reversed(self.elements)}).static_order())

    def has_loop(self) -> bool:
        """Whether the links form a loop."""
        try:
            self.from_sinks()
        except CycleError:
            return True
        return False

    def check_links(self) -> None:
        """Raises `StateError` for a loop, and `ElementFailure` for an unlinked sink pad."""
        if self.has_loop():
            raise StateError("the links form a loop; frames would never leave it")
        if self.delayed_links:
            return
        for element in self.elements:
            for pad in element.sink_pads():
                if pad.peer is None and pad.template.presence is Presence.ALWAYS:
                    raise element.failure(
                        StateError(f"nothing is linked to its pad {pad.name}, so no frame can arrive")
                    )

    def latency(self) -> Latency:
        """Maximum latency of all paths, and the minimum that any of them can buffer.

        Source: GStreamer's latency query.
        """
        if not self.is_live:
            return Latency(False)
        known: dict[Element, Latency] = {}
        for element in reversed(self.from_sinks()):
            upstream = _joined([known[before] for before in element.upstream()])
            minimum_ns, maximum_ns = element.latency()
            is_live = upstream.is_live or (isinstance(element, Source) and bool(element.is_live))
            bounds = upstream.maximum_ns, maximum_ns
            known[element] = Latency(
                is_live,
                upstream.minimum_ns + minimum_ns,
                None if bounds[0] is None or bounds[1] is None else bounds[0] + bounds[1],
            )
        ends = [known[element] for element in self.elements if isinstance(element, Sink)]
        return _joined([end for end in ends if end.is_live] or ends)

    def position_ns(self) -> int | None:
        """Timestamp of the newest frame that a sink with `sync` has rendered, else that a source has sent."""
        for kind in (Sink, Source):
            found = [element.position_ns for element in self.elements if isinstance(element, kind)]
            if newest := [position for position in found if position is not None]:
                return max(newest)
        return None

    def duration_ns(self) -> int | None:
        """Duration of the longest source; None if that of any source is unknown."""
        durations = [element.duration_ns() for element in self.elements if isinstance(element, Source)]
        known = [duration for duration in durations if duration is not None]
        return max(known) if known and len(known) == len(durations) else None


def _joined(paths: list[Latency]) -> Latency:
    bounds = [path.maximum_ns for path in paths if path.maximum_ns is not None]
    return Latency(
        any(path.is_live for path in paths),
        max((path.minimum_ns for path in paths), default=0),
        min(bounds) if bounds else (None if paths else 0),
    )


def auto_name(factory: str, number: int) -> str:
    """An automatic name as in GStreamer: the type, without dashes, and a number per type."""
    plain = factory.replace("-", "")
    return f"{plain}-{number}" if plain[-1:].isdigit() else f"{plain}{number}"


def free_name(factory: str, taken: Container[str]) -> str:
    """The first automatic name of an element type, such as "queue0", that is not taken."""
    names = (auto_name(factory, number) for number in itertools.count())
    return next(name for name in names if name not in taken)
