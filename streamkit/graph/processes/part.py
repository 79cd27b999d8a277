"""Part: one bin with a process, its current child, and the proxies of its elements in the main process."""

from __future__ import annotations

import contextlib
import functools
import threading
import time
from collections import deque
from concurrent.futures import Future, wait
from typing import TYPE_CHECKING, Any

import msgspec

from streamkit.crossing.shared_memory import make_numbers
from streamkit.crossing.values import ValueDecoder, ValueEncoder
from streamkit.element.base import AT_WORK, Element
from streamkit.element.sink import Sink
from streamkit.errors import ElementFailure, ProcessDied, StreamkitError
from streamkit.flow.statistics import ElementStatistics
from streamkit.graph.bins import Bin
from streamkit.graph.graph import Graph
from streamkit.graph.processes.child_process import ANSWER_LIMIT_S, ChildProcess
from streamkit.graph.processes.orders import QUERIES, Counters, Setup
from streamkit.restart_delay import RestartDelay

if TYPE_CHECKING:
    from streamkit.graph.processes.processes import Processes

STATISTICS_LIMIT_S = 1.0
STOP_ORDER_LIMIT_S = 1.0  # a child that reads no orders does not take it
FIRST_RESTART_S, MAX_RESTART_S = 0.1, 5.0  # delays


class Part:
    """The elements of one process, as the main process sees them.

    Attributes:
        elements: those of the graph, as the children number them.
        sinks: those in the process.
        values: decodes what comes from it.
        limit_s: of a call of an element in the process, and of its silence; 0 is none.
        is_streaming: whether the process has been ordered to.
        child: its process; the newest if it was started again; None before the start and after the end.
        has_ended: whether everything in it has come to its end.
        restarts_s: when its process was started again, within the window of the bin.
        ending: the thread that ends this part, after the messages that others have posted before.
    """

    def __init__(self, graph: Graph, home: Bin) -> None:
        self.home = home
        self.elements = list(graph.elements)
        self._graph = graph
        self.values = ValueDecoder(graph.packages)
        members = [element for element, found in graph.homes.items() if found is home]
        self.sinks = [element for element in members if isinstance(element, Sink)]
        self.child: ChildProcess | None = None
        self._marks: memoryview | None = None  # number of the newest frame, then `at_work` of each element
        self.reset(0.0)
        for element in members:
            self._make_proxy(element, self.elements.index(element))

    def reset(self, watchdog_s: float) -> None:
        """Resets the state of an earlier run; without a limit of its own the bin has the pipeline's."""
        self.limit_s = self.home.watchdog_s or watchdog_s
        self.has_ended = False
        self.ending: threading.Thread | None = None
        self.restarts_s: deque[float] = deque()
        self._delay = RestartDelay(FIRST_RESTART_S, MAX_RESTART_S)
        self.is_streaming = False
        self._counters: Counters = ([], [])

    def spawn(self, processes: Processes) -> ChildProcess:
        """Starts a child with the current properties; `processes` hears of its reports and its end."""
        encoder = ValueEncoder()
        properties = [
            {
                declaration.attribute: encoder.encode(getattr(element, declaration.attribute))
                for declaration in element.properties.values()
                if declaration.read is None and not declaration.readonly
            }
            for element in self.elements
        ]
        graph, number = self._graph, self._graph.processes.index(self.home)
        setup = Setup(graph.text, dict(graph.variables), number, properties, self.limit_s)
        self._marks, descriptor = make_numbers(1 + len(self.elements))
        self._marks[0] = -1
        self.child = ChildProcess(self, setup, descriptor, processes)
        self.is_streaming = False
        self.child.start()
        return self.child

    def next_delay_s(self) -> float | None:
        """Counts a restart; the delay before it, longer than the last in the window, or None at the limit."""
        times_s, now_s = self.restarts_s, time.monotonic()
        while times_s and now_s - times_s[0] > self.home.restart_window_s:
            times_s.popleft()
        if len(times_s) >= self.home.restart:
            return None
        if not times_s:
            self._delay.reset()
        times_s.append(now_s)
        return self._delay.after()

    def failure(self, cause: StreamkitError, last_received: int) -> ElementFailure:
        """The error for the end of the process: of the element that was at work, at its frame, if known.

        Args:
            cause: what has happened.
            last_received: number of the newest frame received from anywhere, -1 before one; used if no frame
                has come into the process.
        """
        element: Element = self.home
        if self._marks is not None:
            marks = zip(self.elements, self._marks[1:], strict=True)
            at_work = {marked for marked, mark in marks if mark == AT_WORK}
            element = next((e for e in self._graph.from_sinks() if e in at_work), element)
            last_received = self._marks[0] if self._marks[0] >= 0 else last_received
        where = f"frame seq={last_received}" if last_received >= 0 else ""
        return ElementFailure(element.name, element.factory, cause, where)

    def statistics(self) -> Counters:
        """Of the elements, in the order of `elements`, and of the process.

        The last known if it does not answer; empty before it first did.
        """
        with contextlib.suppress(ProcessDied):
            found = self.ask("statistics", limit_s=STATISTICS_LIMIT_S)
            self._counters = msgspec.convert(found, Counters)
        return self._counters

    def begin_stop(self) -> None:
        """Orders the process to stop; it answers with its last counters."""
        if self.child is not None:
            self.child.silence_limit_s = 0.0
        self.order("stop", limit_s=STOP_ORDER_LIMIT_S).add_done_callback(self._stopped)

    def _stopped(self, answer: Future[Any]) -> None:
        if answer.exception() is None:
            self._counters = msgspec.convert(answer.result(), Counters)

    def rows(self) -> dict[Element, ElementStatistics]:
        """The counters of each element in its process; empty before the first answer."""
        return dict(zip(self.elements, self.statistics()[0], strict=False))

    def order(self, name: str, *arguments: Any, **options: Any) -> Future[Any]:
        """Sends an order to the newest child; without one, the future has the exception `ProcessDied`."""
        child = self.child
        if child is not None:
            return child.order(name, *arguments, **options)
        answer = Future[Any]()
        answer.set_exception(ProcessDied(f"the process of {self.home.name} does not run"))
        return answer

    def ask(self, name: str, *arguments: Any, limit_s: float = ANSWER_LIMIT_S) -> Any:
        """Sends an order and waits for the answer.

        Raises:
            ProcessDied: the process does not run, has ended, or does not answer in time.
            Exception: the order failed.
        """
        answer = self.order(name, *arguments, limit_s=limit_s)
        if not wait([answer], limit_s).done:
            raise ProcessDied(f"the process of {self.home.name} has not answered for {limit_s:g} s")
        return answer.result()

    def try_ask(self, name: str, *arguments: Any) -> None:
        """Sends an order and waits for its end, or that of the process."""
        with contextlib.suppress(ProcessDied):
            self.ask(name, *arguments)

    def _make_proxy(self, element: Element, number: int) -> None:
        """Sends changes of properties to the process of an element, and answers queries from there."""
        changed = type(element).property_changed

        def forward(name: str) -> None:
            changed(element, name)
            # A process that has ended is no matter: a new one will start with the value.
            self.try_ask("set", number, name, ValueEncoder().encode(getattr(element, name)))

        def ask(method: str) -> Any:
            with contextlib.suppress(ProcessDied):
                return self.ask("query", number, method)
            return getattr(type(element), method)(element)

        vars(element)["property_changed"] = forward
        for method in QUERIES:
            if hasattr(element, method):
                vars(element)[method] = functools.partial(ask, method)
