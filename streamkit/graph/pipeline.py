"""Pipeline: a graph that can be started, watched and stopped."""

from __future__ import annotations

import enum
import threading
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

from streamkit.element.base import Element
from streamkit.element.pad import Presence
from streamkit.element.sink import Sink
from streamkit.element.source import Source
from streamkit.errors import ElementFailure, ResourceError, StateError, StreamkitError
from streamkit.flow.clock import Clock, SystemClock
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.bus import Bus
from streamkit.graph.chain import Chain
from streamkit.graph.graph import Graph
from streamkit.graph.statistics import ElementStatistics, Tally, collect_statistics
from streamkit.graph.streaming import Streaming, StreamingThread

STOP_LIMIT_S = 5.0


class State(enum.StrEnum):
    """What a pipeline is doing."""

    NULL = "null"
    READY = "ready"
    PAUSED = "paused"
    PLAYING = "playing"


class Pipeline:
    """A graph of elements that streams.

    `Pipeline.parse(text)` makes one; as a context manager it stops at the end of the block.

    Attributes:
        graph: the elements and links.
        bus: messages from the elements.
        state: null, ready, paused or playing.
    """

    def __init__(self, graph: Graph, clock: Clock | None = None) -> None:
        self.graph = graph
        self.bus = Bus()
        self.state = State.NULL
        self.clock: Clock = clock or SystemClock()
        self.error: Exception | None = None
        self.ended = threading.Event()
        self._lock = threading.RLock()
        self._ending = threading.Lock()
        self._started: list[Element] = []
        self._threads: list[StreamingThread] = []
        self._chains: list[Chain] = []
        self._open_sinks: set[str] = set()
        self._tally = Tally()
        self.bus.watch(self._tally)

    @classmethod
    def parse(cls, text: str, variables: Mapping[str, str] | None = None, clock: Clock | None = None) -> Self:
        """Builds a pipeline from a description.

        Args:
            text: in gst-launch's language, with `#` comments and `${VARIABLES}`.
            variables: values for `${NAME}`.
            clock: another clock than the machine's.

        Raises:
            DescriptionError: the text cannot become a graph; points into the text.
        """
        from streamkit.graph.build import build

        return cls(build(text, variables or {}), clock)

    def __getitem__(self, name: str) -> Any:
        return self.graph.element(name)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    # States.

    def ready(self) -> None:
        """Starts every element, sinks first; a failure stops those already started.

        Raises:
            ElementFailure: an element could not start.
        """
        with self._lock:
            if self.state is not State.NULL:
                return
            self._demand_links()
            self.error = None
            self.ended.clear()
            self.bus.flush()
            self._tally.counts.clear()
            for element in self.graph.from_sinks():
                element.stopping.clear()
                element.clock = self.clock
                element.poster = self._posted
                element.pipeline_error = lambda: self.error
                self._started.append(element)
                try:
                    element.start()
                except Exception as cause:
                    failure = cause if isinstance(cause, ElementFailure) else element.failure(cause)
                    self._stop_elements()
                    raise failure from cause
            self._change_state(State.READY)

    def play(self) -> None:
        """Starts streaming, or goes on after a pause.

        Raises:
            ElementFailure: an element could not start.
        """
        with self._lock:
            self.ready()
            begins = self.state is State.READY
            for element in self.graph.elements:
                element.is_playing = True
                if isinstance(element, Source) and not begins:
                    element.hold(False)
            self._change_state(State.PLAYING)
            if begins:
                self._begin_streaming()

    def pause(self) -> None:
        """Holds every source between two frames."""
        with self._lock:
            if self.state is not State.PLAYING:
                raise StateError(f"only a playing pipeline can be paused, this one is {self.state}")
            for element in self.graph.elements:
                if isinstance(element, Source):
                    element.hold(True)
            self._change_state(State.PAUSED)

    def finish(self) -> None:
        """Makes every source end its stream; EOS then travels behind the last frames."""
        for element in self.graph.elements:
            if isinstance(element, Source):
                element.finish()

    def stop(self) -> None:
        """Ends streaming and stops every element that was started; returns within bounds.

        Raises:
            StateError: a thread did not end in time; names its element.
        """
        with self._lock:
            if self.state is State.NULL and not self._started:
                return
            for element in self.graph.elements:
                element.stopping.set()
            for element in self.graph.elements:
                self._interrupt(element)
            deadline = time.monotonic() + STOP_LIMIT_S
            stuck = [thread.element.name for thread in self._threads if not thread.join(deadline)]
            self._threads = []
            self._stop_elements()
            self._change_state(State.NULL)
            self.ended.set()
        if stuck:
            raise StateError(
                f"{', '.join(stuck)}: a call has not come back within {STOP_LIMIT_S:g} s of the stop; "
                "its thread is left behind"
            )

    # Waiting.

    def wait(self, timeout_s: float | None = None) -> Message | None:
        """Waits for the end: the eos or error message, or None when the time is over."""
        return self.bus.pop(timeout_s, (MessageKind.EOS, MessageKind.ERROR))

    def run(self, timeout_s: float | None = None) -> None:
        """Plays until EOS, then stops.

        Raises:
            ElementFailure: an element failed; every started element has been stopped.
            StateError: EOS has not come within `timeout_s`.
        """
        try:
            self.play()
            message = self.wait(timeout_s)
        finally:
            self.stop()
        if message is None:
            raise StateError(f"the pipeline has not ended within {timeout_s} s")
        if message.error is not None:
            raise message.error

    def statistics(self) -> list[ElementStatistics]:
        """Counters of every element since streaming began."""
        return collect_statistics(self.graph, self._chains, self._tally.counts, self.clock.monotonic_ns())

    # Inside.

    def _demand_links(self) -> None:
        """Refuses a graph with a sink pad that nothing is linked to: it would wait for ever."""
        for element in self.graph.elements:
            for pad in element.sink_pads():
                if pad.peer is None and pad.template.presence is Presence.ALWAYS:
                    raise element.failure(
                        StateError(f"nothing is linked to its pad {pad.name}, so no frame would ever come")
                    )

    def _begin_streaming(self) -> None:
        for element in self.graph.elements:
            for pad in element.pads.values():
                pad.reset()
            element.drops.clear()
        self._open_sinks = {element.name for element in self.graph.elements if isinstance(element, Sink)}
        self._chains = self.compose()
        self._threads = []
        for element in self.graph.from_sinks():
            if isinstance(element, Streaming):
                element.prepare_run()
                self._threads.append(StreamingThread(element, self._failed, self._thread_ended))
        for thread in self._threads:
            thread.start()

    def compose(self) -> list[Chain]:
        """Composes the chain behind every src pad."""
        chains = []
        for element in self.graph.elements:
            for pad in element.src_pads():
                chain = Chain(pad)
                pad.push = chain.compose()
                chains.append(chain)
        return chains

    def _interrupt(self, element: Element) -> None:
        if isinstance(element, Source):
            element.halt()
        try:
            element.interrupt()
        except Exception as cause:
            self._posted(Message(MessageKind.WARNING, element.name, f"interrupt failed: {cause}"))

    def _stop_elements(self) -> None:
        """Stops the started elements, sources first, so that sinks close last with all they got."""
        while self._started:
            element = self._started.pop()
            element.is_playing = False
            try:
                element.stop()
            except Exception as cause:
                failure = element.failure(cause)
                self._posted(Message(MessageKind.WARNING, element.name, f"stop failed: {failure}"))

    def _change_state(self, state: State) -> None:
        if state is not self.state:
            self.state = state
            self.bus.post(Message(MessageKind.STATE, "", str(state), {"state": str(state)}))

    def _posted(self, message: Message) -> None:
        """Takes a message of an element; the EOS of the last sink becomes the pipeline's."""
        if message.kind is not MessageKind.EOS:
            self.bus.post(message)
            return
        self._open_sinks.discard(message.source)
        if not self._open_sinks:
            self._post_eos()

    def _post_eos(self) -> None:
        with self._ending:
            if self.ended.is_set() or self.error is not None:
                return
            self.ended.set()
        self.bus.post(Message(MessageKind.EOS, "", "end of stream"))

    def _thread_ended(self) -> None:
        """Nothing more can come once every thread has ended: that is the end even where a sink saw no EOS."""
        stopping = any(element.stopping.is_set() for element in self.graph.elements)
        if not stopping and all(thread.has_ended for thread in self._threads):
            self._post_eos()

    def _failed(self, error: Exception) -> None:
        """An element's thread ended with an error: the first one is the pipeline's."""
        source = error.element if isinstance(error, ElementFailure) else ""
        with self._ending:
            is_first = self.error is None
            if is_first:
                self.error = error if isinstance(error, StreamkitError) else ResourceError(str(error))
        if is_first:
            self.bus.post(Message(MessageKind.ERROR, source, str(error), error=self.error))
            self.ended.set()
        else:
            self.bus.post(Message(MessageKind.WARNING, source, f"after the first error: {error}"))
