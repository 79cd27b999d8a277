"""Counters of a running graph: what came in, what went out, what was dropped and why, busy time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import msgspec

from streamkit.graph.chain import Chain
from streamkit.graph.graph import Graph


class ElementStatistics(msgspec.Struct, frozen=True):
    """Counters of one element since streaming began.

    Attributes:
        element: its name.
        frames_in: frames that arrived.
        frames_out: frames that left, over all src pads.
        dropped: frames not delivered, by reason.
        busy_ns: sampled working time, ns; for a sink with all it calls, for a queue the time to hand over.
    """

    element: str
    frames_in: int
    frames_out: int
    dropped: dict[str, int]
    busy_ns: int


def collect_statistics(graph: Graph, chains: Iterable[Chain]) -> list[ElementStatistics]:
    """The counters of every element of a graph, in its order."""
    came, left, busy = Counter[str](), Counter[str](), Counter[str]()
    for chain in chains:
        left[chain.src.element.name] += chain.frames
        for index, (element, count, busy_ns) in enumerate(chain.received()):
            came[element.name] += count
            busy[element.name] += busy_ns
            if index < len(chain.transforms):
                left[element.name] += count - chain.swallowed[index]
    return [
        ElementStatistics(name, came[name], left[name], dict(element.drops), busy[name])
        for name, element in ((element.name, element) for element in graph.elements)
    ]
