"""Counters of a running graph: what came in, what went out, what was dropped and why, working time, age.

Every frame is counted once per chain, and the clock is read once per element and frame.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any, Literal

import msgspec

from streamkit.element.base import Element
from streamkit.element.pad import Pad
from streamkit.element.sink import Sink
from streamkit.element.source import Source
from streamkit.element.transform import Transform
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.chain import Chain, RetiredChainTotals
from streamkit.graph.graph import Graph
from streamkit.handoff.frame_queue import FrameQueue


class PadStatistics(msgspec.Struct, frozen=True):
    """Counters of one pad since streaming began.

    Attributes:
        pad: its name.
        direction: "sink" or "src".
        frames: frames that went through it.
        peer: element and pad it is linked to, "queue0.sink", or None.
        caps: the caps in force, or None before negotiation.
    """

    pad: str
    direction: str
    frames: int
    peer: str | None
    caps: str | None


class QueueLevels(msgspec.Struct, frozen=True):
    """What an element that holds frames holds now, and the most it held since streaming began.

    Attributes:
        buffers: frames held.
        bytes: their size.
        time_ns: from the oldest to the newest, ns.
        max_buffers: the most frames it held, or None where that is not counted.
        max_bytes: the most bytes it held, or None where that is not counted.
        max_time_ns: the longest time it held, or None where that is not counted.
        limit_buffers: how many frames make it full; 0 is no limit.
    """

    buffers: int
    bytes: int
    time_ns: int
    max_buffers: int | None
    max_bytes: int | None
    max_time_ns: int | None
    limit_buffers: int


class ElementStatistics(msgspec.Struct, frozen=True):
    """Counters of one element since streaming began.

    Attributes:
        element: its name.
        parent: name of the bin it stands in, or "".
        factory: its type.
        frames_in: frames that arrived, over all sink pads.
        frames_out: frames that left, over all src pads.
        dropped: frames not delivered, by reason.
        errors: failures of the element.
        warnings: warnings it posted.
        busy_ns: working time, ns. Of a source: the time it took to make frames, 0 for a live one,
            whose waiting is no work. Of a queue: what upstream took to hand frames over, waiting included.
        age_ns: how long ago the newest frame seen arrived at its source, ns; None before a frame.
        queue: what it holds, or None for an element that holds no frames.
        pads: counters of each pad.
    """

    element: str
    parent: str
    factory: str
    frames_in: int
    frames_out: int
    dropped: dict[str, int]
    errors: int
    warnings: int
    busy_ns: int
    age_ns: int | None
    queue: QueueLevels | None
    pads: list[PadStatistics]


class RunStatistics(msgspec.Struct, frozen=True, kw_only=True):
    """The counters of a whole graph: the JSON of `launch --stats=json`, told in docs/statistics.md.

    Attributes:
        schema: name and version of the object's shape.
        elapsed_s: since the run began, s.
        elements: one entry for each element, in the order of the description.
    """

    schema: Literal["streamkit.statistics/1"] = "streamkit.statistics/1"
    elapsed_s: float
    elements: list[ElementStatistics]


class Tally:
    """Counts errors and warnings of each element, as a watcher of the bus."""

    def __init__(self) -> None:
        self.counts: Counter[tuple[str, MessageKind]] = Counter()

    def __call__(self, message: Message) -> None:
        """Counts one message."""
        if message.kind in (MessageKind.ERROR, MessageKind.WARNING):
            self.counts[message.source, message.kind] += 1


class _Sums:
    """What the chains of a graph add up to, by pad and by element, whose name another may share."""

    def __init__(self, chains: Iterable[Chain], retired: RetiredChainTotals) -> None:
        self.frames: Counter[Pad] = Counter()
        self.came: Counter[int] = Counter()
        self.left: Counter[int] = Counter(retired.frames)
        self.busy_ns: Counter[int] = Counter()
        self.newest_ns: dict[int, int] = {}
        self._behind: dict[int, list[Chain]] = {}
        self._retired = retired
        for chain in chains:
            self._behind.setdefault(id(chain.src.element), []).append(chain)
            self._add(chain)
        for owner in [behind[0].src.element for behind in self._behind.values()]:
            self._settle(owner, self._behind[id(owner)])

    def _add(self, chain: Chain) -> None:
        """Adds what one chain counted."""
        self._leave(chain.src, chain.frames)
        newest_ns = 0
        for stage, count in reversed(chain.received()):
            newest_ns = stage.newest_ns or newest_ns  # a stage that is not called passes what came behind it
            element = stage.element
            self._see(element, newest_ns)
            self.came[id(element)] += count
            self.frames[stage.sink] += count
            self.busy_ns[id(element)] += stage.busy_ns
            if isinstance(element, Transform):
                self._leave(element.src_pad, count - stage.swallowed)
        self._see(chain.src.element, newest_ns)

    def _leave(self, pad: Pad, count: int) -> None:
        self.frames[pad] += count
        self.left[id(pad.element)] += count

    def _see(self, element: Element, newest_ns: int) -> None:
        self.newest_ns[id(element)] = max(newest_ns, self.newest_ns.get(id(element), 0))

    def _settle(self, owner: Element, behind: list[Chain]) -> None:
        """Tells the work of an element from that of the chains it calls: a source's, a tee's."""
        if isinstance(owner, Source):
            made_ns = 0 if owner.is_live else behind[0].upstream_ns
            self.busy_ns[id(owner)] = made_ns - sum(self._spent_ns(chain) for chain in behind[1:])
        elif not isinstance(owner, Transform) and not hasattr(owner, "stream"):  # with no thread of its own
            called_ns = self._retired.busy_ns[id(owner)]
            self.busy_ns[id(owner)] -= called_ns + sum(self._spent_ns(chain) for chain in behind)

    def _spent_ns(self, chain: Chain) -> int:
        """Working time in a chain, with the chains of transforms that make several frames of one."""
        nested = (
            beyond
            for stage in chain.stages
            if isinstance(stage.element, Transform)
            for beyond in self._behind.get(id(stage.element), ())
        )
        return chain.busy_ns + sum(self._spent_ns(beyond) for beyond in nested)


def collect_statistics(
    graph: Graph,
    chains: Iterable[Chain],
    retired: RetiredChainTotals,
    counts: Counter[tuple[str, MessageKind]],
    now_ns: int,
) -> list[ElementStatistics]:
    """The counters of every element of a graph, in its order.

    Args:
        graph: its elements.
        chains: the chains of its run.
        retired: what the chains of removed branches had counted.
        counts: messages by element and kind.
        now_ns: time of the pipeline's clock, ns.
    """
    sums = _Sums(chains, retired)

    def row(element: Element) -> ElementStatistics:
        name = element.name
        newest_ns = sums.newest_ns.get(id(element), 0)
        waited_ns = element.waited_ns if isinstance(element, Sink) else 0
        return ElementStatistics(
            element=name,
            parent=element.parent,
            factory=element.factory,
            frames_in=sums.came[id(element)],
            frames_out=sums.left[id(element)],
            dropped=dict(element.drops),
            errors=counts[name, MessageKind.ERROR],
            warnings=counts[name, MessageKind.WARNING],
            busy_ns=max(0, sums.busy_ns[id(element)] - waited_ns),
            age_ns=max(0, now_ns - newest_ns) if newest_ns else None,
            queue=_levels(element),
            pads=[_pad_row(pad, sums.frames[pad]) for pad in list(element.pads.values())],
        )

    return [row(element) for element in graph.elements]


def _pad_row(pad: Pad, frames: int) -> PadStatistics:
    peer, caps = pad.peer, pad.caps
    return PadStatistics(
        pad=pad.name,
        direction=str(pad.template.direction),
        frames=frames,
        peer=peer.path if peer is not None else None,
        caps=str(caps) if caps is not None else None,
    )


def _levels(element: Any) -> QueueLevels | None:
    """What an element holds in its `pending` frames; None where it holds none."""
    pending = getattr(element, "pending", None)
    if not isinstance(pending, FrameQueue):
        return None
    return QueueLevels(
        buffers=pending.buffers,
        bytes=pending.bytes,
        time_ns=pending.time_ns,
        max_buffers=pending.highest_buffers,
        max_bytes=pending.highest_bytes,
        max_time_ns=pending.highest_time_ns,
        limit_buffers=getattr(element, "max_size_buffers", getattr(element, "max_buffers", 0)),
    )
