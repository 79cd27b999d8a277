"""Playback: one run of a graph, from the start of its threads to their end."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from typing_extensions import override

from streamkit.element.base import Element, Host
from streamkit.element.pad import Pad
from streamkit.element.pad_owner import walk
from streamkit.element.sink import Sink
from streamkit.element.source import Source
from streamkit.errors import StateError
from streamkit.flow.events import EOS, FLUSH_START, FLUSH_STOP
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.statistics import ElementStatistics
from streamkit.graph.branches import BranchOutputs
from streamkit.graph.chain import Chain, compose_chain, compose_chains
from streamkit.graph.element_calls import Watchdog
from streamkit.graph.linking import report_missing_pads
from streamkit.graph.negotiate import remember_caps
from streamkit.graph.statistics import RetiredChains, collect_statistics, silent_transforms
from streamkit.graph.streaming import StreamEnd, Streaming, StreamingThread

if TYPE_CHECKING:
    from streamkit.graph.pipeline import Pipeline

log = logging.getLogger("streamkit")


class Playback(Host):
    """The threads and chains of a streaming graph, and the host of its elements.

    Attributes:
        pipeline: whose graph runs.
        chains: one for each src pad.
        retired: the counters of chains of removed branches.
        end: tracks the end of the run.
        branches: the outputs whose branches join, leave or may fail alone.
        is_streaming: whether threads were started.
        cpu_began_ns: processor time that the process had used when they were, ns.
        is_over_elsewhere: whether all that runs in other processes has ended.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self.chains: list[Chain] = []
        self.retired = RetiredChains()
        self.end = StreamEnd(pipeline.bus)
        self.pipeline = pipeline
        self._graph, self._bus, self._timing = pipeline.graph, pipeline.bus, pipeline.timing
        self.is_streaming = False
        self._lock = threading.RLock()
        self._threads: list[StreamingThread] = []
        self.branches = BranchOutputs(self)
        self._watchdog: Watchdog | None = None
        self._is_stopping = False
        self.cpu_began_ns = 0
        self.is_over_elsewhere: Callable[[], bool] = lambda: True

    def begin(self) -> None:
        """Makes the chains; starts the watchdog and a thread for every source and queue."""
        graph = self._graph
        local = graph.local()
        for element in graph.elements:
            element.begin_run()
            element.is_playing = True
        self.end.expect_end(self._sinks())
        self._expect_preroll()
        remember_caps(graph)
        self.chains = []  # without those of pads that `start` has added
        compose_chains(local, self.chains)
        self.branches.open()
        threads = self.add_threads(filter(graph.is_local, graph.from_sinks()))
        self.is_streaming = True
        self.cpu_began_ns = time.process_time_ns()
        self._watchdog = Watchdog(self)
        self._watchdog.start()
        for thread in threads:
            thread.start()

    def abandon(self) -> None:
        """Stops the pipeline, which the program has left playing when it ended."""
        if not (self.pipeline.ends_with_program or self.end.ended.is_set()):
            log.warning("the program has ended, its pipeline had not: use `with` or stop()")
        self.pipeline.stop()

    def add_threads(self, elements: Iterable[Element]) -> list[StreamingThread]:
        """Makes threads, not started yet, for the sources and queues among the elements."""
        return [
            self._add_thread(element, element.stream)
            for element in elements
            if isinstance(element, Streaming)
        ]

    def _add_thread(self, element: Element, stream: Callable[[], None]) -> StreamingThread:
        thread = StreamingThread(element, stream, self)
        with self._lock:
            self._threads.append(thread)
        return thread

    def join(self, deadline: float, elements: Iterable[Element]) -> list[str]:
        """Waits until the threads of some elements end; returns the names of those in which one did not."""
        with self._lock:
            members = set(elements)
            threads = [thread for thread in self._threads if thread.element in members]
        for thread in threads:
            thread.join(max(0.0, deadline - time.monotonic()))
        with self._lock:
            self._threads = [thread for thread in self._threads if thread not in threads]
        return [self._element_inside(thread.element).name for thread in threads if thread.is_alive()]

    def _element_inside(self, first: Element) -> Element:
        """The element that the streaming thread of a source or queue is in a call of, or the first one."""
        stages = [stage for chain in self.chains if chain.src.element is first for stage in chain.stages]
        called = next((stage.element for stage in stages if stage.element.activity is not None), None)
        return first if called is None else self._element_inside(called)

    def refuse_own_thread(self) -> None:
        """Raises `StateError` if the caller is a streaming thread of the graph."""
        if threading.current_thread() in self._threads:
            raise StateError(
                "stop() was called by one of the pipeline's own streaming threads, which cannot wait for "
                "themselves; call finish() there, or stop() from the thread that plays the pipeline"
            )

    def finish(self) -> None:
        """Makes every source end its stream with EOS."""
        for element in self._graph.local():
            if isinstance(element, Source):
                element.finish()

    def stop(self) -> None:
        """Stops reporting hangs and the end of the stream; reports transforms that gave no frame."""
        self._is_stopping = True
        if self.is_streaming and self.error is None:  # a failed run ends before what elements hold comes out
            for name, text in silent_transforms(self.rows(0)).items():
                self._bus.post(Message(MessageKind.WARNING, name, text, {"code": "shortfall"}))
        if self._watchdog is not None:
            self._watchdog.stop()

    # Pausing and flushing.

    def pause(self) -> None:
        """Pauses running time; sinks hold their next frame."""
        self._expect_preroll()  # before: a sink holds its next frame, and says so once, as soon as time stops
        self._timing.pause()
        self._refresh()

    def resume(self) -> None:
        """Resumes rendering."""
        self._timing.resume()
        self._refresh()

    def _refresh(self) -> None:
        """Makes chains and waits follow the running time, which has begun or ended."""
        for chain in list(self.chains):
            chain.refresh()
        for element in self._graph.elements:
            element.wake()

    def _expect_preroll(self) -> None:
        self.end.expect_preroll([] if self._graph.is_live else self._sinks())

    def flush(self, *, begins: bool) -> None:
        """Begins to drop all frames in flight, or lets sources continue with their next frame."""
        roots = self._graph.roots()
        if begins:  # upstream first: a thread that the flush unwinds finds that it has begun there, too
            reached = set(walk(roots, Element.downstream))
            for element in filter(self._graph.is_local, reversed(self._graph.from_sinks())):
                if element in reached:
                    element.flush(begins=True)
        for pad in [pad for root in roots for pad in root.src_pads()]:
            pad.send_event(FLUSH_START if begins else FLUSH_STOP)
        if begins:
            for root in roots:
                root.await_frame_in_flight()
            self._expect_preroll()
            return
        for root in roots:
            root.flush(begins=False)

    # Called by elements, as their host.

    @property
    @override
    def error(self) -> Exception | None:
        return self.end.error

    @override
    def prerolled(self, element: Element) -> None:
        self.end.sink_prerolled(element)

    def reconfigure(self, element: Element) -> None:
        """Makes the sources upstream of an element renegotiate before their next frame."""
        with self._lock:
            remember_caps(self._graph)
        for source in walk([element], Element.upstream):
            if isinstance(source, Source):
                source.renegotiate()

    @override
    def elements(self) -> Sequence[Element]:
        return tuple(self._graph.elements)

    @override
    def statistics(self, now_ns: int) -> list[ElementStatistics]:
        return list(self.rows(now_ns).values())

    def rows(self, now_ns: int) -> dict[Element, ElementStatistics]:
        """The counters of the elements, in textual order."""
        return collect_statistics(self, now_ns)

    def pad_added(self, pad: Pad) -> None:
        """Tries the delayed links of a new pad, and composes the chain behind it."""
        with self._lock:
            known = set(self._graph.elements)
            for link in list(self._graph.delayed_links):
                link.try_link(pad)
            joined = [element for element in self._graph.elements if element not in known]
            for element in joined:
                self.pipeline.adopt(element)
            remember_caps(self._graph)
            compose_chains(joined, self.chains)
            compose_chain(pad, self.chains)
        pad.element.pads_changed()

    def no_more_pads(self, element: Element) -> None:
        """Warns of delayed links without a pad and sends EOS to their sinks.

        Raises:
            ElementFailure: no pad of the element is linked, for example because a decoder is missing.
        """
        report_missing_pads(element, self._graph.delayed_links, self._bus.post)
        for other in list(self._graph.elements):
            for pad in other.sink_pads():
                if pad.peer is None and not pad.is_eos:
                    pad.receive_event(EOS)

    # Adding and removing branches.

    def join_branch(self, src: Pad, elements: list[Element]) -> None:
        """Starts streaming into a branch of started elements behind a request pad."""
        with self._lock:
            sinks = [element for element in elements if isinstance(element, Sink)]
            self.end.expect_end(sinks)
            if not self._timing.running.is_set() and not self._graph.is_live:
                self.end.expect_preroll(sinks)
            for element in elements:
                element.begin_run()
            compose_chains(elements, self.chains)
            threads = self.add_threads(elements)
            chain = Chain(src)
            self.chains.append(chain)
            src.is_eos = False  # from now on EOS reaches the branch
        self.branches.join(src, chain.push)
        src.element.pads_changed()
        if any(pad.has_upstream_ended for pad in src.element.sink_pads()):
            threads.append(self._add_thread(elements[0], src.send_eos))
        for thread in threads:
            thread.start()

    def leave_branch(self, src: Pad, elements: list[Element]) -> None:
        """Removes a branch; the run no longer waits for its sinks."""
        with self._lock:
            self.retired.retire(src, elements, self.chains)
        self.end.remove(elements)

    # End of the run.

    @override
    def sink_ended(self, element: Element) -> None:
        self.end.remove([element])

    def fail(self, error: Exception) -> None:
        """Handles a failure: drops the branch if that is allowed, else ends the run."""
        if not (self.is_streaming and self.branches.drop_branch_of(error)):
            self.end.fail(error)

    def thread_ended(self) -> None:
        """Ends the run once every thread of all processes has ended, even if a sink did not get EOS."""
        is_over = all(thread.has_ended for thread in self._threads) and self.is_over_elsewhere()
        if not self._is_stopping and is_over:
            self.end.post_eos()

    def _sinks(self) -> list[Sink]:
        """The sinks whose end this process awaits: those of other processes, too, in the main one."""
        members = self._graph.elements if self._graph.here is None else self._graph.local()
        return [element for element in members if isinstance(element, Sink)]
