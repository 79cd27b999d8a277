"""Part: one bin with a process, its current child, and the proxies of its elements in the main process."""

from __future__ import annotations

import contextlib
import functools
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import msgspec

from streamkit.crossing.values import ValueDecoder, ValueEncoder, packages_of
from streamkit.element.base import AT_WORK, Element
from streamkit.element.sink import Sink
from streamkit.errors import ElementFailure, ProcessDied, StreamkitError
from streamkit.graph.bins import Bin
from streamkit.graph.graph import Graph
from streamkit.graph.processes.child_process import ChildProcess
from streamkit.graph.processes.orders import QUERIES, Report, Setup
from streamkit.graph.processes.work_marks import WorkMarks
from streamkit.graph.statistics import ElementStatistics, ProcessStatistics

STATISTICS_LIMIT_S = 1.0


class Part:
    """The elements of one process, as the main process sees them.

    Args:
        graph: the whole graph.
        home: the bin.

    Attributes:
        elements: those of the graph, as the children number them.
        sinks: those in the process.
        limit_s: of a call of an element in the process, and of its silence; 0 is none.
        child: its process; the newest if it was started again; None before the start and after the end.
        has_ended: whether everything in it has come to its end.
        restarts: times (monotonic, s) at which it was started again, within the window.
        ending: the thread that waits for what others have to say before.
    """

    def __init__(self, graph: Graph, home: Bin) -> None:
        self.home = home
        self.elements = list(graph.elements)
        self._graph = graph
        self._values = ValueDecoder(packages_of(type(element) for element in self.elements))
        members = [element for element, found in graph.homes.items() if found is home]
        self.sinks = [element for element in members if isinstance(element, Sink)]
        self.limit_s = 0.0
        self.child: ChildProcess | None = None
        self.has_ended = False
        self.restarts: deque[float] = deque()
        self.ending: threading.Thread | None = None
        self._marks: WorkMarks | None = None
        self._rows: list[ElementStatistics] = []
        self._process_rows: list[ProcessStatistics] = []
        for element in members:
            self._make_proxy(element, self.elements.index(element))

    def reset(self, watchdog_s: float) -> None:
        """Resets the state of an earlier run; without a limit of its own the bin has the pipeline's."""
        self.limit_s = self.home.watchdog_s or watchdog_s
        self.has_ended = False
        self.restarts.clear()
        self._rows, self._process_rows = [], []

    def spawn(
        self, reported: Callable[[ChildProcess, Report], None], ended: Callable[[ChildProcess], None]
    ) -> ChildProcess:
        """Starts a child with the properties that the elements have now; see there."""
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
        self._marks, descriptor = WorkMarks.make(len(self.elements))
        self.child = ChildProcess(
            self.home.name, setup, descriptor, len(graph.processes) + 1, reported, ended
        )
        self.child.start()
        return self.child

    def may_restart(self) -> bool:
        """Whether the limit of restarts is not reached; if so, counts one."""
        now_s = time.monotonic()
        while self.restarts and now_s - self.restarts[0] > self.home.restart_window_s:
            self.restarts.popleft()
        if len(self.restarts) >= self.home.restart:
            return False
        self.restarts.append(now_s)
        return True

    def failure(self, cause: StreamkitError, last_received: int) -> ElementFailure:
        """The error for the end of the process: of the element that was at work, at its frame, if known.

        Args:
            cause: what has happened.
            last_received: number of the newest frame received from anywhere, -1 before one; used if no frame
                has come into the process.
        """
        element: Element = self.home
        if self._marks is not None:
            marks = zip(self.elements, self._marks.at_work, strict=True)
            at_work = {marked for marked, mark in marks if mark == AT_WORK}
            element = next((e for e in self._graph.from_sinks() if e in at_work), element)
            if self._marks.last_frame[0] >= 0:
                last_received = self._marks.last_frame[0]
        where = f"frame seq={last_received}" if last_received >= 0 else ""
        return ElementFailure(element.name, element.factory, cause, where)

    def statistics(self) -> list[ElementStatistics]:
        """The counters in the process, in the order of `elements`; the last known if it does not answer."""
        with contextlib.suppress(ProcessDied):
            if self.child is not None:
                found = self.child.ask("statistics", limit_s=STATISTICS_LIMIT_S)
                self._rows = msgspec.convert(found, list[ElementStatistics])
        return self._rows

    def process_statistics(self) -> list[ProcessStatistics]:
        """The counters of the process; the last known if it does not answer, none before it first did."""
        with contextlib.suppress(ProcessDied):
            if self.child is not None:
                found = self.child.ask("process_statistics", limit_s=STATISTICS_LIMIT_S)
                self._process_rows = [msgspec.convert(found, ProcessStatistics)]
        return self._process_rows

    def try_order(self, name: str) -> None:
        """Sends an order without waiting; nothing happens if the process has ended."""
        with contextlib.suppress(ProcessDied):
            if self.child is not None:
                self.child.order(name)

    def _make_proxy(self, element: Element, number: int) -> None:
        """Sends changes of properties to the process of an element, and answers queries from there."""
        changed = type(element).property_changed

        def forward(name: str) -> None:
            changed(element, name)
            with contextlib.suppress(ProcessDied):  # a new one will start with the value
                if self.child is not None:
                    self.child.ask("set", number, name, ValueEncoder().encode(getattr(element, name)))

        def ask(method: str) -> Any:
            if self.child is None:
                return getattr(type(element), method)(element)
            return self._values.decode(self.child.ask("query", number, method))

        vars(element)["property_changed"] = forward
        for method in QUERIES:
            if hasattr(element, method):
                vars(element)[method] = functools.partial(ask, method)
