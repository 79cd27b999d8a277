"""Pipeline: a graph that can be started, watched and stopped."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

from streamkit.element.base import Element
from streamkit.element.source import Source
from streamkit.element.timing import Timing
from streamkit.errors import StateError
from streamkit.flow.clock import Clock, SystemClock
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.branches import Branch, add_branch, remove_branch
from streamkit.graph.bus import Bus
from streamkit.graph.element_calls import CallLimits, start_element, stop_elements, wake_elements
from streamkit.graph.graph import Graph
from streamkit.graph.playback import Playback
from streamkit.graph.queries import Latency, duration_ns, graph_latency, position_ns
from streamkit.graph.states import State, StateChange
from streamkit.graph.statistics import ElementStatistics, Tally, collect_statistics

STOP_LIMIT_S = 5.0
WATCHDOG_S = 30.0


class Pipeline:
    """A graph of elements that streams.

    `Pipeline.parse(text)` makes one; as a context manager it stops at the end of the block.

    Attributes:
        graph: the elements and links.
        bus: messages from the elements.
        state: null, ready, paused or playing.
        timing: the running time.
        watchdog_s: an element that does not come back with a frame for so long fails; other calls that take
            so long (`start`, `drain`, `stop`) are warned of, and `stop` is given up. 0 is never.
    """

    def __init__(self, graph: Graph, clock: Clock | None = None, watchdog_s: float = WATCHDOG_S) -> None:
        self.graph = graph
        self.bus = Bus()
        self.state = State.NULL
        self.clock: Clock = clock or SystemClock()
        self.timing = Timing(lambda: self.clock)
        self.watchdog_s = watchdog_s
        self._cancelled = threading.Event()
        self._lock = threading.RLock()
        self._started: list[Element] = []
        self._tally = Tally()
        self.bus.watch(self._tally)
        self._playback = Playback(self.graph, self.bus, self.timing, self._adopt)

    @classmethod
    def parse(
        cls,
        text: str,
        variables: Mapping[str, str] | None = None,
        clock: Clock | None = None,
        watchdog_s: float = WATCHDOG_S,
    ) -> Self:
        """Builds a pipeline from a description.

        Args:
            text: in gst-launch's language, with `#` comments and `${VARIABLES}`.
            variables: values for `${NAME}`.
            clock: another clock than the machine's.
            watchdog_s: longest time that an element may take for a frame, s; 0 is for ever.

        Raises:
            DescriptionError: the text cannot become a graph; points into the text.
        """
        from streamkit.graph.build import build

        return cls(build(text, variables or {}), clock, watchdog_s)

    def __getitem__(self, name: str) -> Any:
        return self.graph.element(name)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def error(self) -> Exception | None:
        """The failure that ended the run, or None."""
        return self._playback.end.error

    @property
    def ended(self) -> threading.Event:
        """Set at the end of the stream, after a failure, and after a stop."""
        return self._playback.end.ended

    @property
    def is_live(self) -> bool:
        """Whether any source is live: its frames do not wait for anybody."""
        return self._playback.is_live

    # States.

    def ready(self) -> None:
        """Starts every element, sinks first; a failure stops those already started.

        From a higher state it ends streaming and leaves the elements started.

        Raises:
            ElementFailure: an element could not start, or `cancel` was called meanwhile.
        """
        with self._lock:
            if self.state in (State.PAUSED, State.PLAYING):
                self.stop()
            if self.state is not State.NULL:
                return
            self.graph.demand_links()
            self._cancelled.clear()
            self._playback = Playback(self.graph, self.bus, self.timing, self._adopt)
            self.timing.reset()
            self.timing.running.set()
            self.bus.flush()
            self._tally.counts.clear()
            try:
                for element in self.graph.from_sinks():
                    self._adopt(element)
            except BaseException:
                stop_elements(self._started, self._limits())
                raise
            self._change_state(State.READY)

    def play(self) -> StateChange:
        """Starts streaming, or goes on after a pause.

        Raises:
            ElementFailure: an element could not start.
        """
        with self._lock:
            if self.state is State.PLAYING:
                return StateChange.SUCCESS
            if self.state is State.NULL:
                self.ready()
            begins = self.state is State.READY
            self._set_playing(True)
            self._change_state(State.PLAYING)
            if self.is_live:
                self.timing.latency_ns = self.latency().minimum_ns
                self.timing.begin()
            if begins:
                self._playback.begin(self.watchdog_s)
            else:
                self._playback.go_on()
        return StateChange.SUCCESS

    def pause(self) -> StateChange:
        """Makes sinks hold the next frame that comes, and live sources wait; running time stands still.

        A pipeline that does not stream yet begins to, up to the first frame in each sink: `wait_prerolled`.

        Raises:
            ElementFailure: an element could not start.
        """
        with self._lock:
            if self.state is State.NULL:
                self.ready()
            if self.state is State.READY:
                self.timing.hold()
                self._set_playing(True)
                self._change_state(State.PAUSED)
                self._playback.begin(self.watchdog_s)
            elif self.state is State.PLAYING:
                self._playback.hold()
                self._change_state(State.PAUSED)
            if self.is_live:
                return StateChange.NO_PREROLL
            return StateChange.SUCCESS if self._playback.end.is_prerolled.is_set() else StateChange.ASYNC

    def wait_prerolled(self, timeout_s: float) -> bool:
        """Waits until every sink of the paused pipeline holds its first frame.

        Raises:
            ElementFailure: the pipeline has failed instead.
        """
        return self._playback.end.wait_prerolled(timeout_s)

    def flush(self) -> None:
        """Drops every frame that is on its way, as a jump to the newest of a live feed needs it."""
        with self._lock:
            if self.state in (State.PAUSED, State.PLAYING):
                self._playback.flush()

    def cancel(self) -> None:
        """Ends a start or a stop that is under way; may be called from any thread or signal handler.

        A start then raises `ElementFailure` (of `StartCancelled`), after elements that have started were
        stopped; a stop gives up the calls that have not come back.
        """
        self._cancelled.set()

    def finish(self) -> None:
        """Makes every source end its stream; EOS then travels behind the last frames."""
        for element in self.graph.elements:
            if isinstance(element, Source):
                element.finish()

    def stop(self) -> None:
        """Ends streaming and stops every element that was started; returns within bounds.

        Raises:
            StateError: a thread did not end in time, which is named; or a thread of the graph itself calls.
        """
        if self._playback.is_own_thread():
            raise StateError(
                "stop() was called by one of the pipeline's own streaming threads, which cannot wait for "
                "themselves; call finish() there, or stop() from the thread that plays the pipeline"
            )
        with self._lock:
            if self.state is State.NULL and not self._started:
                return
            self._cancelled.clear()
            self._playback.stop()
            stuck = self._end_streaming(self.graph.elements)
            stuck += stop_elements(self._started, self._limits())
            self._change_state(State.NULL)
            self.ended.set()
        if stuck:
            raise StateError(
                f"{', '.join(dict.fromkeys(stuck))}: a call has not come back within {STOP_LIMIT_S:g} s "
                "of the stop; its thread is left behind"
            )

    # Waiting and looking.

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
        chains, retired = list(self._playback.chains), self._playback.retired
        now_ns = self.clock.monotonic_ns()
        return collect_statistics(self.graph, chains, retired, self._tally.counts, now_ns)

    def latency(self) -> Latency:
        """How old live frames are at the sinks at least, and for how long they can be held."""
        found = graph_latency(self.graph)
        if warning := found.warning():
            self.bus.post(Message(MessageKind.WARNING, "", warning, {"code": "latency"}))
        return found

    def position_ns(self) -> int | None:
        """Timestamp of the newest frame that a synchronised sink has shown; None where there is none."""
        return position_ns(self.graph)

    def duration_ns(self) -> int | None:
        """How long the longest source streams; None where one has no end or cannot tell."""
        return duration_ns(self.graph)

    # Branches.

    def add_branch(self, element: str, description: str) -> Branch:
        """Links a description behind a request pad of an element (a tee), also while playing.

        Args:
            element: name of the element that has request pads.
            description: begins with an element that takes frames, as "queue ! fakesink".

        Raises:
            DescriptionError: the text is wrong, or cannot be linked there.
            ElementFailure: an element of the branch could not start; nothing of it remains.
        """
        with self._lock:
            return add_branch(self.graph, element, description, self._playback if self._started else None)

    def remove_branch(self, branch: Branch, timeout_s: float = 2.0) -> None:
        """Unlinks a branch; it ends with EOS, finishes what it has within `timeout_s`, and is stopped.

        Raises:
            StateError: one of its threads did not end in time; names it.
        """
        with self._lock:
            remove_branch(self.graph, branch, self._playback if self._started else None, timeout_s)
            stuck = self._end_streaming(branch.elements)
            stuck += stop_elements([e for e in self._started if e in branch.elements], self._limits())
            self._started = [element for element in self._started if element not in branch.elements]
        if stuck:
            raise StateError(f"{', '.join(stuck)}: a call has not come back; its thread is left behind")

    # Inside.

    def _limits(self) -> CallLimits:
        return CallLimits(self.watchdog_s, max(STOP_LIMIT_S, self.watchdog_s), self._cancelled, self._posted)

    def _adopt(self, element: Element) -> None:
        """Starts an element as one of this pipeline."""
        element.clock = self.clock
        element.timing = self.timing
        element.host = self._playback
        element.poster = self._posted
        element.pipeline_error = lambda: self.error
        self._started.append(element)
        start_element(element, self._limits())
        element.is_playing = self.state in (State.PAUSED, State.PLAYING)

    def _set_playing(self, value: bool) -> None:
        for element in self.graph.elements:
            element.is_playing = value

    def _end_streaming(self, elements: list[Element]) -> list[str]:
        """Ends the threads of some elements; names of those that did not."""
        wake_elements(elements, self._posted)
        return self._playback.join(time.monotonic() + STOP_LIMIT_S, elements)

    def _change_state(self, state: State) -> None:
        if state is not self.state:
            self.state = state
            self.bus.post(Message(MessageKind.STATE, "", str(state), {"state": str(state)}))

    def _posted(self, message: Message) -> None:
        """Takes a message of an element; a sink's EOS counts, and only that of the last is posted."""
        if message.kind is not MessageKind.EOS:
            self.bus.post(message)
            return
        for element in self.graph.elements:
            if element.name == message.source:
                self._playback.sink_ended(element)
