"""Pipeline: starts, monitors and stops a graph."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from os import PathLike
from typing import Any, Self

from streamkit.element.base import Element
from streamkit.element.waits import Timing
from streamkit.errors import StateError
from streamkit.flow.clock import Clock, SystemClock
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.statistics import ElementStatistics, ProcessStatistics
from streamkit.graph.branches import Branch, add_branch, remove_branch
from streamkit.graph.bus import Bus
from streamkit.graph.element_calls import check_ended, start_element, stop_elements, wake_elements
from streamkit.graph.files import FileConflict, check_files
from streamkit.graph.graph import Graph, Latency
from streamkit.graph.playback import Playback
from streamkit.graph.processes.processes import Processes
from streamkit.graph.statistics import measure_process
from streamkit.graph.streaming import State, StateChange

STOP_LIMIT_S = 5.0
WATCHDOG_S = 30.0


class Pipeline:
    """A graph of elements that streams; `Pipeline.parse(text)` makes one. A context manager that stops it.

    A pipeline is stopped, too, when the main thread and the thread that played it have both ended.

    Attributes:
        graph: the elements and links.
        bus: messages from the elements.
        state: null, ready, paused or playing.
        timing: the running time.
        watchdog_s: time limit of an element's calls: for a frame the element fails; for `start`, `drain` and
            `stop` a warning is posted, and `stop` is abandoned. 0 is no limit.
        cancelled: set by `cancel`, until the start or stop that it ends is over.
        ends_with_program: whether the program may end before the pipeline; else that is logged.
    """

    ends_with_program = False

    def __init__(self, graph: Graph, clock: Clock | None = None, watchdog_s: float = WATCHDOG_S) -> None:
        if not isinstance(graph, Graph):
            raise TypeError(
                f"Pipeline takes a Graph, got {graph!r}; make one of a text by Pipeline.parse(text)"
            )
        self.graph = graph
        self.bus = Bus()
        self.state = State.NULL
        self.clock: Clock = clock or SystemClock()
        self.timing = Timing(lambda: self.clock)
        self.watchdog_s = watchdog_s
        self.cancelled = threading.Event()
        self._lock = threading.RLock()
        self._started: list[Element] = []
        self._playback = Playback(self)
        self._processes = Processes(self)

    @classmethod
    def parse(
        cls,
        text: str,
        variables: Mapping[str, str | float | PathLike[str]] | None = None,
        clock: Clock | None = None,
        watchdog_s: float = WATCHDOG_S,
    ) -> Self:
        """Builds a pipeline from a description.

        Args:
            text: in gst-launch's language, with `#` comments and `${VARIABLES}`.
            variables: values of `${NAME}`: texts, numbers or paths.
            clock: instead of the system clock.
            watchdog_s: time limit of an element's calls, s; 0 is none.

        Raises:
            DescriptionError: the text is invalid; points into the text.
        """
        from streamkit.graph.build import build

        texts = {name: str(value) for name, value in (variables or {}).items()}
        return cls(build(text, texts), clock, watchdog_s)

    def __getitem__(self, name: str) -> Any:
        return self.graph.element(name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self.stop()
        except StateError as stuck:
            if error is None:
                raise
            error.add_note(str(stuck))  # what came first is raised: a failure, or Ctrl-C
        if error is None:
            self.bus.log_unread_error()

    @property
    def error(self) -> Exception | None:
        """The failure that ended the run, or None."""
        return self._playback.error

    @property
    def ended(self) -> threading.Event:
        """Set at EOS, failure and stop."""
        return self._playback.end.ended

    @property
    def is_live(self) -> bool:
        """Whether any source is live."""
        return self.graph.is_live

    # States.

    def ready(self) -> None:
        """Starts every element, sinks first; from a higher state, stops first.

        Raises:
            ElementFailure: an element could not start, or `cancel` was called; started elements are stopped.
        """
        with self._lock:
            if self.state.is_streaming:
                self.stop()
            if self.state is not State.NULL:
                return
            self.graph.check_links()
            try:
                check_files(self.graph)
            except FileConflict as error:
                raise error.element.failure(error) from None
            self._playback = Playback(self)
            self.timing.reset()
            self.bus.flush()
            try:
                self._processes.start(self._playback)
                for element in self.graph.from_sinks():
                    self.adopt(element)
            except BaseException:
                self._stop(self._started)
                self._processes.stop()
                self.cancelled.clear()
                raise
            self._change_state(State.READY)

    def play(self) -> StateChange:
        """Starts streaming, or resumes after a pause.

        Raises:
            ElementFailure: an element could not start.
        """
        with self._lock:
            if self.state is State.PLAYING:
                return StateChange.SUCCESS
            if self.state is State.NULL:
                self.ready()
            begins = self.state is State.READY
            self._change_state(State.PLAYING)
            if self.is_live:
                self.timing.latency_ns = self.latency().minimum_ns
                self.timing.begin()
            if begins:
                self._playback.begin()
            else:
                self._playback.resume()
            self._processes.stream("play")
        return StateChange.SUCCESS

    def pause(self) -> StateChange:
        """Pauses running time, live sources, and sinks at their next frame.

        A pipeline that does not stream yet prerolls up to the first frame in each sink: `wait_prerolled`.

        Raises:
            ElementFailure: an element could not start.
        """
        with self._lock:
            if self.state is State.NULL:
                self.ready()
            if self.state is State.READY:
                self.timing.pause()
                self._change_state(State.PAUSED)
                self._playback.begin()
                self._processes.stream("pause")
            elif self.state is State.PLAYING:
                self._playback.pause()
                self._change_state(State.PAUSED)
                self._processes.stream("pause")
            if self.is_live:
                return StateChange.NO_PREROLL
            return StateChange.SUCCESS if self._playback.end.is_prerolled else StateChange.ASYNC

    def wait_prerolled(self, timeout_s: float) -> bool:
        """Waits until every sink of the paused pipeline holds its first frame.

        Raises:
            ElementFailure: the pipeline failed.
        """
        return self._playback.is_streaming and self._playback.end.wait_prerolled(timeout_s)

    def flush(self) -> None:
        """Drops all frames in flight, for example to jump to the newest of a live feed."""
        with self._lock, self._processes.flushing():
            self.flush_here(begins=True)
            self.flush_here(begins=False)

    def flush_here(self, *, begins: bool) -> None:
        """Begins or ends a flush in this process, as one of those between which a frame may be."""
        if self.state.is_streaming:
            self._playback.flush(begins=begins)

    def cancel(self) -> None:
        """Cancels a start or stop in progress, or the next start; safe in any thread or signal handler.

        The start raises `ElementFailure` (of `StartCancelled`) after stopping started elements; the stop
        abandons calls that did not return.
        """
        self.cancelled.set()

    def finish(self) -> None:
        """Makes every source end its stream with EOS."""
        self._playback.finish()
        self._processes.finish()

    def stop(self) -> None:
        """Ends streaming and stops every started element, within time limits.

        Raises:
            StateError: a thread did not end in time, or the caller is a streaming thread.
        """
        self._playback.refuse_own_thread()
        with self._lock:
            if self.state is State.NULL and not self._started:
                return
            self.cancelled.clear()
            self._playback.stop()
            self._processes.begin_stop()
            stuck = self._end_streaming(self.graph.elements)
            stuck += self._stop(self._started)
            self._processes.stop()
            self._playback.branches.relink()
            self.cancelled.clear()
            self._change_state(State.NULL)
            self.ended.set()
        check_ended(stuck, STOP_LIMIT_S)

    # Waiting and queries.

    def wait(self, timeout_s: float | None = None) -> Message | None:
        """Waits for the eos or error message; None at the timeout, and when another thread calls `stop`."""
        return self.bus.pop(timeout_s, (MessageKind.EOS, MessageKind.ERROR))

    def run(self, timeout_s: float | None = None) -> None:
        """Plays until EOS, then stops; returns, too, when another thread calls `stop`.

        Raises:
            ElementFailure: an element failed.
            StateError: no EOS within `timeout_s`.
        """
        with self:
            self.play()
            message = self.wait(timeout_s)
            if message is None and self.state is not State.NULL:
                raise StateError(f"the pipeline has not ended within {timeout_s:g} s")
            if message is not None and message.error is not None:
                raise message.error

    def statistics(self) -> list[ElementStatistics]:
        """Counters of every element since streaming began."""
        return self._processes.merge(self._playback.rows(self.clock.monotonic_ns()))

    def process_statistics(self) -> list[ProcessStatistics]:
        """Counters of every process since streaming began, the main process first."""
        rows = self._playback.rows(self.clock.monotonic_ns())
        own = measure_process(self._playback, rows)
        return [own, *self._processes.statistics()]

    def latency(self) -> Latency:
        """Minimum and maximum latency of live frames; posts a warning if they cannot be buffered."""
        found = self.graph.latency()
        if text := found.warning():
            self.bus.post(Message(MessageKind.WARNING, "", text, {"code": "latency"}))
        return found

    def position_ns(self) -> int | None:
        """Timestamp of the newest frame that a sink with `sync` has rendered, else that a source has sent."""
        return self.graph.position_ns()

    def duration_ns(self) -> int | None:
        """Duration of the longest source; None if that of any source is unknown."""
        return self.graph.duration_ns()

    # Branches.

    def add_branch(self, element: str, description: str) -> Branch:
        """Links a description to a request pad of an element (a tee), also while playing.

        Args:
            element: name of the element that has request pads.
            description: starts with an element with a sink pad, as "queue ! fakesink".

        Raises:
            KeyError: the pipeline has no element of the name.
            DescriptionError: the text is invalid, or cannot be linked.
            ElementFailure: an element of the branch could not start; the branch is removed.
        """
        with self._lock:
            return add_branch(self._playback, element, description)

    def remove_branch(self, branch: Branch, timeout_s: float = 2.0) -> None:
        """Sends EOS into a branch, lets it drain for `timeout_s`, then unlinks and stops it.

        Raises:
            StateError: a thread did not end in time.
        """
        with self._lock:
            remove_branch(self._playback, branch, timeout_s)
            stuck = self._end_streaming(branch.elements)
            stuck += self._stop([element for element in self._started if element in branch.elements])
            self._started = [element for element in self._started if element not in branch.elements]
        check_ended(stuck, STOP_LIMIT_S)

    def _stop(self, elements: list[Element]) -> list[str]:
        return stop_elements(elements, self, max(STOP_LIMIT_S, self.watchdog_s))

    def adopt(self, element: Element) -> None:
        """Adds an element to this pipeline and starts it."""
        element.clock = self.clock
        element.timing = self.timing
        element.host = self._playback
        element.poster = self.bus.post
        if self.graph.is_local(element):
            start_element(element, self._started, self)
            element.is_playing = self.state.is_streaming

    def _end_streaming(self, elements: list[Element]) -> list[str]:
        wake_elements(elements, self.bus.post)
        return self._playback.join(time.monotonic() + STOP_LIMIT_S, elements)

    def _change_state(self, state: State) -> None:
        if state is not self.state:
            self.state = state
            self.bus.post(Message(MessageKind.STATE, "", str(state), {"state": str(state)}))
