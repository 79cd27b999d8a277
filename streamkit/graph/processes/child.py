"""The child process: builds the whole graph, runs the part in its bin, and follows the parent's orders."""

from __future__ import annotations

import faulthandler
import functools
import gc
import os
import resource
import socket
import sys
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from streamkit.crossing.channel import Channel, ChannelClosed
from streamkit.crossing.shared_memory import map_numbers
from streamkit.crossing.values import ValueDecoder
from streamkit.errors import ResourceError, StateError
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.build import build
from streamkit.graph.files import named_files
from streamkit.graph.graph import Graph
from streamkit.graph.pipeline import Pipeline
from streamkit.graph.processes.link_writer import COUNTS
from streamkit.graph.processes.orders import (
    ENCODER,
    ORDERS,
    QUERIES,
    Counters,
    Dropped,
    Order,
    OrderResult,
    Setup,
    encode_failure,
    encode_message,
)
from streamkit.graph.processes.process_link import ProcessLink
from streamkit.graph.processes.sandbox import enter_sandbox
from streamkit.handoff.endwithparent import end_with_parent
from streamkit.output.names import local_path

# These wait for elements: they run one after another in a thread of their own, the others at once.
IN_ORDER = frozenset({"ready", "play", "pause", "flush", "stop"})


class Child:
    """The graph of a description with one process to run, as the parent's first message says."""

    def __init__(self, setup: Setup, control: Channel) -> None:
        self._control = control
        self._in_order = ThreadPoolExecutor(1, "streamkit:orders")
        graph = build(setup.text, setup.variables)
        self._values = ValueDecoder(graph.packages)
        graph.run_only(graph.processes[setup.number])
        self._pipeline = Pipeline(graph, watchdog_s=setup.watchdog_s)
        for element, properties in zip(graph.elements, setup.properties, strict=True):
            for name, value in properties.items():
                decoded = self._values.decode(value)
                if getattr(element, name) != decoded:
                    setattr(element, name, decoded)
        descriptor = control.take_descriptor()
        marks = map_numbers(descriptor, 1 + len(graph.elements))
        os.close(descriptor)
        for number, element in enumerate(graph.elements):
            element.at_work = marks[number + 1 : number + 2]
            if isinstance(element, ProcessLink):
                element.last_frame = marks[:1]
                vars(element)["count_drop"] = functools.partial(self._report_drop, number)
        self._orders: dict[str, Callable[..., Any]] = {
            "ready": self._pipeline.ready,
            "play": self._play,
            "pause": self._pipeline.pause,
            "stop": self._stop,
            "flush": lambda begins: self._pipeline.flush_here(begins=begins),
            "finish": self._pipeline.finish,
            "ping": lambda: None,  # the answer shows that the interpreter runs
            "connect": self._connect,
            "give-up": lambda number: list(graph.process_links)[number].give_up(),
            "set": self._set,
            "statistics": self._statistics,
            "query": self._query,
        }
        self._pipeline.bus.watch(self._post)
        self._limit(graph)

    def _limit(self, graph: Graph) -> None:
        """Limits what this process may do: once everything is imported, before other threads start."""
        home = graph.here
        assert home is not None
        if home.memory_mb:
            most = home.memory_mb * 2**20
            if (used := private_bytes()) >= most:
                raise ResourceError(
                    f"{home.name}: memory-mb={home.memory_mb}: the process has {used >> 20} MiB before its "
                    "first frame; allow more than that"
                )
            resource.setrlimit(resource.RLIMIT_DATA, (most, most))
        if home.sandbox:
            missing = enter_sandbox(readable_files(graph))
            if missing:
                text = f"sandbox: {missing}"
                self._pipeline.bus.post(Message(MessageKind.WARNING, home.name, text))

    def listen(self, messages: list[bytes]) -> None:
        """Takes orders until the channel closes, first those that have been received already."""
        self._send(ENCODER.encode(OrderResult(0)))  # it is set up: from now on its silence is limited
        while True:
            for message in messages:
                order = ORDERS.decode(message)
                assert isinstance(order, Order)
                if order.name == "stop":
                    self._pipeline.cancel()
                if order.name in IN_ORDER:
                    self._in_order.submit(self._execute, order)
                else:
                    self._execute(order)
            messages = self._control.receive()

    def _execute(self, order: Order) -> None:
        answer = OrderResult(order.number)
        try:
            answer.value = self._orders[order.name](*order.arguments)
        except Exception as error:
            answer.failure = encode_failure(error)
        self._send(ENCODER.encode(answer))
        if order.name == "stop":
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(0)  # whatever threads libraries have left

    def _send(self, message: bytes) -> None:
        try:
            self._control.send(message)
        except ChannelClosed:
            os._exit(1)  # the parent has died

    def _post(self, message: Message) -> None:
        if message.kind is not MessageKind.STATE:
            self._send(ENCODER.encode(encode_message(message)))

    def _report_drop(self, number: int, reason: str, count: int = 1) -> None:
        self._send(ENCODER.encode(Dropped(number, reason, count)))

    # Orders.

    def _play(self, base_ns: int | None, latency_ns: int) -> None:
        timing = self._pipeline.timing
        timing.follow(base_ns, latency_ns)
        self._pipeline.play()
        gc.freeze()  # garbage collection of imported objects would block a live feed for 60 ms
        timing.follow(base_ns, latency_ns)

    def _stop(self) -> Counters:
        self._pipeline.stop()
        return self._statistics()  # the last ones

    def _statistics(self) -> Counters:
        return self._pipeline.statistics(), self._pipeline.process_statistics()

    def _connect(self, number: int) -> None:
        link = list(self._pipeline.graph.process_links)[number]
        end, counts = self._control.take_descriptor(), self._control.take_descriptor()
        try:
            link.connect(socket.socket(fileno=end), map_numbers(counts, COUNTS))
        finally:
            os.close(counts)

    def _set(self, number: int, name: str, value: Any) -> None:
        self._pipeline.graph.elements[number].set_property(name, self._values.decode(value))

    def _query(self, number: int, method: str) -> Any:
        if method not in QUERIES:
            raise StateError(f"there is no query {method}")
        return getattr(self._pipeline.graph.elements[number], method)()


def readable_files(graph: Graph) -> Iterator[str]:
    """The files that properties of local elements name, and the folders of those that stand for several."""
    for file in named_files(graph.local()):
        path = local_path(file.location)
        yield str(path)
        if "%" in path.name or "*" in path.name:
            yield str(path.parent)


def private_bytes() -> int:
    """Memory of this process that counts for `RLIMIT_DATA`, and its stack."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[5]) * resource.getpagesize()


def main() -> None:
    """Runs a part of a pipeline; the arguments are the descriptor of the control channel and the parent."""
    if not end_with_parent(int(sys.argv[2])):
        raise StateError("the parent has ended")
    faulthandler.enable()
    control = Channel(socket.socket(fileno=int(sys.argv[1])))
    try:
        while not (messages := control.receive()):
            continue
        setup = ORDERS.decode(messages[0])
        assert isinstance(setup, Setup)
        Child(setup, control).listen(messages[1:])
    except ChannelClosed:
        os._exit(1)
    except ResourceError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        os._exit(1)
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)


if __name__ == "__main__":
    main()
