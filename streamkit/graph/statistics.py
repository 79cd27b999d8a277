"""Counts what passes a running graph: frames in, out and dropped, working time, age; what each process costs.

Every frame is counted once per chain; the clock is read once per element and frame.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import structs

from streamkit.element.base import Element
from streamkit.element.frame_queue import FrameHolder
from streamkit.element.pad import Pad
from streamkit.element.registry import available_elements
from streamkit.element.source import Source
from streamkit.element.transform import Transform
from streamkit.flow.messages import MessageKind
from streamkit.flow.statistics import ElementStatistics, PadStatistics, ProcessStatistics
from streamkit.graph.bins import Bin
from streamkit.graph.chain import Chain
from streamkit.graph.graph import Graph
from streamkit.graph.processes.process_link import LOST, ProcessLink
from streamkit.graph.streaming import Streaming
from streamkit.masking import mask_secrets

if TYPE_CHECKING:
    from streamkit.graph.playback import Playback

MAIN = "main"


class RetiredChains:
    """Frames and working time (ns) of the chains of removed branches, by the element before them."""

    def __init__(self) -> None:
        self.frames: Counter[Element] = Counter()
        self.busy_ns: Counter[Element] = Counter()

    def retire(self, src: Pad, elements: Iterable[Element], chains: list[Chain]) -> None:
        """Removes the chains of the branch behind a src pad; keeps the totals of the first."""
        members = set(elements)
        for chain in [chain for chain in chains if chain.src is src or chain.src.element in members]:
            chains.remove(chain)
            if chain.src is src:
                self.frames[src.element] += chain.frames
                self.busy_ns[src.element] += chain.busy_ns
        for element in members:
            del self.frames[element], self.busy_ns[element]


class _ChainTotals:
    """Totals of the chains of a graph by pad and by element."""

    def __init__(self, chains: Iterable[Chain], retired: RetiredChains) -> None:
        self.frames: Counter[Pad] = Counter()
        self.frames_in: Counter[Element] = Counter()
        self.frames_out: Counter[Element] = Counter(retired.frames)
        self.busy_ns: Counter[Element] = Counter()
        self.newest_ns: Counter[Element] = Counter()
        self._behind: dict[Element, list[Chain]] = {}
        self._retired = retired
        for chain in chains:
            self._behind.setdefault(chain.src.element, []).append(chain)
            self._add(chain)
        for owner, behind in self._behind.items():
            self._attribute_work(owner, behind)

    def _add(self, chain: Chain) -> None:
        self._count_output(chain.src, chain.frames)
        newest_ns = 0
        for stage, count in reversed(chain.received()):
            newest_ns = stage.newest_ns or newest_ns  # a bypassed stage has the time of the next one
            element = stage.element
            self.newest_ns[element] = max(self.newest_ns[element], newest_ns)
            self.frames_in[element] += count
            self.frames[stage.sink] += count
            self.busy_ns[element] += stage.busy_ns
            if isinstance(element, Transform):
                self._count_output(element.src_pad, count - stage.not_passed_on)
        self.newest_ns[chain.src.element] = max(self.newest_ns[chain.src.element], newest_ns)

    def _count_output(self, pad: Pad, count: int) -> None:
        self.frames[pad] += count
        self.frames_out[pad.element] += count

    def _attribute_work(self, owner: Element, behind: list[Chain]) -> None:
        """Separates the work of a source or tee from that of the chains that it calls."""
        if isinstance(owner, Source):
            made_ns = 0 if owner.is_live else behind[0].upstream_ns
            self.busy_ns[owner] = made_ns - sum(self._spent_ns(chain) for chain in behind[1:])
        elif not isinstance(owner, Transform | Streaming):  # without its own thread
            called_ns = self._retired.busy_ns[owner]
            self.busy_ns[owner] -= called_ns + sum(self._spent_ns(chain) for chain in behind)

    def _spent_ns(self, chain: Chain) -> int:
        """Working time in a chain, including chains behind transforms that return several frames."""
        transforms = [stage.element for stage in chain.stages if isinstance(stage.element, Transform)]
        beyond = (nested for element in transforms for nested in self._behind.get(element, ()))
        return chain.busy_ns + sum(map(self._spent_ns, beyond))


def collect_statistics(playback: Playback, now_ns: int) -> dict[Element, ElementStatistics]:
    """The counters of every element of a run's graph, in order, at a time of the pipeline's clock, ns."""
    pipeline, counts = playback.pipeline, playback.pipeline.bus.counts
    totals = _ChainTotals(list(playback.chains), playback.retired)  # streaming threads may add some

    def row(element: Element) -> ElementStatistics:
        name = element.name
        newest_ns = totals.newest_ns[element]
        return ElementStatistics(
            element=name,
            parent=element.parent,
            factory=element.factory,
            frames_in=totals.frames_in[element],
            frames_out=totals.frames_out[element],
            dropped=dict(element.drops),
            results=dict(element.results),
            outcomes=dict(element.outcomes),
            location=mask_secrets(getattr(element, "location", "")) if element.results["files"] else "",
            errors=counts[name, MessageKind.ERROR],
            warnings=counts[name, MessageKind.WARNING],
            busy_ns=max(0, totals.busy_ns[element] - element.waited_ns),
            age_ns=max(0, now_ns - newest_ns) if newest_ns else None,
            queue=element.pending.levels() if isinstance(element, FrameHolder) else None,
            pads=[_pad_row(pad, totals.frames[pad]) for pad in list(element.pads.values())],
            written=[mask_secrets(path) for path in element.written_paths],
            has_failed=element.has_failed,
        )

    return {element: row(element) for element in list(pipeline.graph.elements)}  # branches may join


def silent_transforms(rows: dict[Element, ElementStatistics]) -> dict[str, str]:
    """What to say of transforms that took frames until EOS, gave none and counted none, by name.

    To return None is how a transform leaves a frame out, and also what a forgotten `return` does. Only
    elements of other packages have a user who can write it.
    """
    entries = available_elements()
    for_authors = (
        ", and none is counted as dropped: where `transform` is to pass frames on, `return` them; else count "
        "them with `count_drop`"
    )
    return {
        element.name: f"none of {row.frames_in} frames came out"
        + (for_authors if element.factory not in entries or not entries[element.factory].is_own else "")
        for element, row in rows.items()
        if isinstance(element, Transform)
        and element.src_pad.is_eos
        and row.frames_in
        and not (row.frames_out or row.dropped or row.errors)
    }


def _pad_row(pad: Pad, frames: int) -> PadStatistics:
    peer, caps = pad.peer, pad.caps
    return PadStatistics(
        pad=pad.name,
        direction=str(pad.template.direction),
        frames=frames,
        peer=peer.path if peer is not None else None,
        caps=str(caps) if caps is not None else None,
    )


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


def measure_process(playback: Playback, rows: Mapping[Element, ElementStatistics]) -> ProcessStatistics:
    """The counters of the calling process, with those of its elements in a run."""
    graph, frames, crossings, waited_ns = playback.pipeline.graph, 0, 0, 0
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
        cpu_ns=time.process_time_ns() - playback.cpu_began_ns,
        rss_bytes=resident_bytes(),
        frames=frames,
        crossings=crossings,
        waited_ns=waited_ns,
    )


def resident_bytes() -> int:
    """Memory of this process that is in RAM, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
