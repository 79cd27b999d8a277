"""Processes: the child processes of one pipeline and their links, from their start to their end."""

from __future__ import annotations

import contextlib
import functools
import math
import os
import threading
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, wait
from typing import TYPE_CHECKING, Any, Literal

from streamkit.crossing.channel import Channel
from streamkit.crossing.shared_memory import make_numbers
from streamkit.element.base import Element
from streamkit.errors import (
    ElementFailure,
    HangDetected,
    ProcessDied,
    ResourceError,
    StartCancelled,
    StreamkitError,
)
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.statistics import ElementStatistics, ProcessStatistics
from streamkit.graph.element_calls import CANCEL_GRACE_S
from streamkit.graph.processes.child_process import ANSWER_LIMIT_S, ChildProcess
from streamkit.graph.processes.link_writer import COUNTS
from streamkit.graph.processes.orders import Dropped, Posted, Report, decode_message
from streamkit.graph.processes.part import Part
from streamkit.graph.processes.process_link import ProcessLink
from streamkit.graph.statistics import merge_statistics

if TYPE_CHECKING:
    from streamkit.graph.pipeline import Pipeline
    from streamkit.graph.playback import Playback

POLL_S = 0.2
STOP_LIMIT_S = 5.0
FLUSH_LIMIT_S = 5.0  # of either half


class Processes:
    """Starts, supervises and ends the children of a pipeline; without process bins it does nothing.

    The elements of other processes stand in the pipeline's graph for queries and properties.

    Attributes:
        count: of the processes, the main one included.
    """

    _playback: Playback  # of the current run

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline, self._post, graph = pipeline, pipeline.bus.post, pipeline.graph
        self._parts = {home: Part(graph, home) for home in graph.processes if graph.here is None}
        self.count = len(graph.processes) + 1
        self._links = graph.process_links
        self._numbers = {link: number for number, link in enumerate(self._links)}
        self._connecting = threading.Lock()
        self._stopping = threading.Event()
        self._order: Literal["", "play", "pause"] = ""  # the last order to every child; "" before streaming
        self._is_finishing = False
        self._ordering = threading.Lock()  # the last order that a child gets is the newest

    # Called by the pipeline.

    def start(self, playback: Playback) -> None:
        """Starts every child and makes its elements ready.

        Raises:
            ElementFailure: an element could not start, or that was cancelled; the children are ended.
        """
        self._playback = playback
        self._order, self._is_finishing = "", False
        self._stopping.clear()
        parts = list(self._parts.values())
        if not parts:
            return
        playback.is_over_elsewhere = lambda: all(part.has_ended for part in parts)
        try:
            for part in parts:
                part.reset(self._pipeline.watchdog_s)
                part.spawn(self)
            for link, (writer, _) in self._links.items():
                self._connect(link)
                if writer is not None:  # what it has posted before its EOS comes before that
                    link.before_end = functools.partial(self._await_messages, [self._parts[writer]])
            answers = {part: part.order("ready") for part in parts}
            for part, answer in answers.items():
                self._await_ready(part, answer)
        except BaseException:
            self.stop(is_cancelled=self._pipeline.cancelled.is_set())
            raise

    def _await_ready(self, part: Part, answer: Future[Any]) -> None:
        """Waits for the start of a child's elements; any failure is that of an element."""
        cancelled = self._pipeline.cancelled
        try:
            _await(answer, cancelled)
            if cancelled.is_set():
                raise StartCancelled("the start of the processes was interrupted")
        except ElementFailure:
            raise
        except StreamkitError as error:
            raise part.failure(error, -1) from error

    def stream(self, order: Literal["play", "pause"]) -> None:
        """Makes every child stream, or pause, or preroll its sinks."""
        self._order = order
        for part in self._parts.values():
            with contextlib.suppress(ProcessDied):  # its end is handled in its thread
                self._let_stream(part)

    def _let_stream(self, part: Part) -> None:
        """Brings a child into the state of the pipeline."""
        with self._ordering:
            timing = self._pipeline.timing  # which the children follow
            times = (timing.base_ns, timing.latency_ns) if self._order == "play" else ()
            answer = part.order(self._order, *times)
        _await(answer, self._stopping, ANSWER_LIMIT_S)
        part.is_streaming = True
        if self._is_finishing:
            part.order("finish")

    @contextlib.contextmanager
    def flushing(self) -> Iterator[None]:
        """Context in which every child that streams drops all frames in flight."""
        self._flush(begins=True)
        try:
            yield
        finally:
            self._flush(begins=False)

    def _flush(self, *, begins: bool) -> None:
        answers = [part.order("flush", begins) for part in self._parts.values() if part.is_streaming]
        wait(answers, FLUSH_LIMIT_S)

    def finish(self) -> None:
        """Makes the sources in every child end their streams, also in one that is started again later."""
        self._is_finishing = bool(self._order)
        for part in self._parts.values():
            part.try_ask("finish")

    def merge(self, rows: dict[Element, ElementStatistics]) -> list[ElementStatistics]:
        """The counters of the main process with those of the others."""
        if not self._parts:
            return list(rows.values())
        reported = {home: part.rows() for home, part in self._parts.items()}
        return merge_statistics(self._pipeline.graph, rows, reported)

    def statistics(self) -> list[ProcessStatistics]:
        """The counters of every child."""
        return [row for part in self._parts.values() for row in part.statistics()[1]]

    def begin_stop(self) -> None:
        """Makes every child stop; `stop` waits for its end."""
        self._stopping.set()
        for part in self._parts.values():
            part.begin_stop()

    def stop(self, *, is_cancelled: bool = False) -> None:
        """Ends every child: kills those that do not end in time, soon if their start was cancelled."""
        self.begin_stop()
        limit_s = CANCEL_GRACE_S if is_cancelled else max(STOP_LIMIT_S, self._pipeline.watchdog_s)
        deadline = time.monotonic() + limit_s
        for part in self._parts.values():
            while (child := part.child) is not None:  # a restart may be about to replace it
                child.join(max(0.0, deadline - time.monotonic()))
                child.kill("" if is_cancelled else "has not ended in time and was killed")
                child.join()
                if child.has_died and not (child.is_reported or is_cancelled):
                    failure = part.failure(child.death(), -1)
                    self._post(Message(MessageKind.WARNING, failure.element, f"at the stop: {failure}"))
                part.child = None if part.child is child else part.child
            if part.ending is not None:
                part.ending.join()
        for link in self._links:
            link.disconnect()

    # The links between processes.

    def _connect(self, link: ProcessLink) -> None:
        """Gives the two ends of a new connection to the processes that a link connects.

        One that has died gets none: its restart makes another connection.
        """
        counts, descriptor = make_numbers(COUNTS)
        with self._connecting:  # both ends get the connections of two restarts in the same order
            link.counts.append(counts)
            for home, end in zip(self._links[link], Channel.pair(), strict=True):
                if home is None:
                    link.connect(end, counts)
                    continue
                with end:
                    descriptors = end.fileno(), descriptor
                    self._parts[home].order("connect", self._numbers[link], descriptors=descriptors)
        os.close(descriptor)

    def _reconnect(self, part: Part) -> None:
        """Connects a process that was started again, except to those that have ended for good."""
        for link in self._links_of(part):
            if link.is_given_up:
                part.order("give-up", self._numbers[link])
            else:
                self._connect(link)

    def _give_up(self, part: Part) -> None:
        """Ends the streams from and to a process that has failed."""
        for link in self._links_of(part):
            link.give_up()
            for home in self._links[link]:
                if home is not None and home is not part.home:
                    self._parts[home].order("give-up", self._numbers[link])

    def _links_of(self, part: Part) -> list[ProcessLink]:
        return [link for link, ends in self._links.items() if part.home in ends]

    # Reports and the end of a child, in its thread.

    def reported(self, part: Part, report: Report) -> None:
        """Takes a report of a child."""
        if isinstance(report, Dropped):
            part.elements[report.number].count_drop(report.reason, report.count)
        elif isinstance(report, Posted):
            self._posted(part, decode_message(report, part.values))

    def _posted(self, part: Part, message: Message) -> None:
        """Handles a message of a child: its EOS, errors and `async-done` concern its own part only."""
        if message.kind is MessageKind.EOS:
            part.ending = threading.Thread(target=self._end_part, args=(part,), name=f"{part.home.name}:end")
            part.ending.start()
        elif message.kind is MessageKind.ERROR and message.error is not None:
            self._element_failed(part, message.error)
        elif message.fields.get("name") == "async-done" and not message.source:
            for sink in part.sinks:
                self._playback.prerolled(sink)
        else:
            self._post(message)

    def _end_part(self, part: Part) -> None:
        """Everything in a process has ended; a failure upstream of it is reported first."""
        self._await_messages(other for other in self._parts.values() if other is not part)
        part.has_ended = True
        self._playback.end.remove(part.sinks)
        self._playback.thread_ended()

    def _await_messages(self, parts: Iterable[Part]) -> None:
        """Waits until what some processes have posted so far is on the bus: answers come after it."""
        for part in parts:
            with contextlib.suppress(ProcessDied):
                _await(part.order("ping"), self._stopping, ANSWER_LIMIT_S)

    def child_ended(self, part: Part, child: ChildProcess) -> None:
        """A child has ended; unless the pipeline stops, that is a failure once it streams."""
        while not (self._order or self._stopping.wait(POLL_S)):
            continue
        if self._stopping.is_set():
            return
        child.is_reported = True
        newest = max((link.last_frame[0] for link in self._links if link.reads), default=-1)
        failure = part.failure(child.death(), newest)
        if part.has_ended or part.ending is not None:
            self._post(Message(MessageKind.WARNING, failure.element, f"after its end: {failure}"))
        elif (delay_s := part.next_delay_s()) is None:
            self._fail(part, failure)
        else:
            self._restart(part, failure, delay_s)

    def _restart(self, part: Part, failure: ElementFailure, delay_s: float) -> None:
        """Starts a child in the place of one that has ended, in the old one's thread."""
        text = f"{failure}; restart {len(part.restarts_s)} of {part.home.restart} in {delay_s:g} s"
        self._post(Message(MessageKind.WARNING, failure.element, text, {"code": "process-restart"}))
        if self._stopping.wait(delay_s):
            return
        try:
            child = part.spawn(self)
            self._reconnect(part)
            _await(part.order("ready"), self._stopping)
            if not self._stopping.is_set():
                self._let_stream(part)
        except ProcessDied:
            pass  # its own thread restarts it, or fails
        except StreamkitError as error:
            child.kill(f"could not start again: {error}")
        except OSError as error:  # no descriptor is left in this process
            self._fail(part, part.failure(ResourceError(f"cannot be started again: {error}"), -1))
        if self._stopping.is_set():
            part.order("stop")  # it may have been started after the others were stopped

    def _element_failed(self, part: Part, error: Exception) -> None:
        """An element in a process has failed; one that hangs may be started again, with its process."""
        cause = error.cause if isinstance(error, ElementFailure) else None
        if isinstance(cause, HangDetected) and part.home.restart and part.child is not None:
            part.child.kill(f"hangs: {cause}")
        else:
            self._fail(part, error)

    def _fail(self, part: Part, error: Exception) -> None:
        """An element of a child has failed, or the child has died."""
        self._playback.fail(error)  # first: EOS, which the links now send, would end the run without an error
        part.has_ended = True
        self._give_up(part)


def _await(answer: Future[Any], cancelled: threading.Event, limit_s: float = math.inf) -> None:
    """Waits for the answer to an order, until the limit or cancelled; raises its exception."""
    deadline = time.monotonic() + limit_s
    while not cancelled.is_set() and time.monotonic() < deadline:
        if wait([answer], POLL_S).done:
            answer.result()
            return
