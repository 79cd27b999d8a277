"""Failures of branches behind a tee: drops a branch whose sinks all have `on-error=drop-branch`."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from streamkit.element.base import Element
from streamkit.element.branching import Split
from streamkit.element.pad import Pad
from streamkit.element.sink import OnError, Sink
from streamkit.errors import ElementFailure, NotNegotiated, StreamkitError
from streamkit.flow.events import EOS, EndOfStream, FlowStop
from streamkit.flow.frame import Frame
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.bus import Bus
from streamkit.graph.graph import Graph
from streamkit.graph.stream_end import StreamEnd


def downstream_elements(src: Pad) -> Iterator[Element]:
    """Every element downstream of a src pad, each once."""
    front = [src]
    seen: set[int] = set()
    while front:
        pad = front.pop()
        if pad.peer is None or id(pad.peer.element) in seen:
            continue
        seen.add(id(pad.peer.element))
        yield pad.peer.element
        front.extend(pad.peer.element.src_pads())


def is_expendable(src: Pad) -> bool:
    """Whether the branch behind a src pad of a tee may be dropped."""
    if not isinstance(src.element, Split):
        return False
    sinks = [element for element in downstream_elements(src) if isinstance(element, Sink)]
    return bool(sinks) and all(sink.on_error is OnError.DROP_BRANCH for sink in sinks)


def expendable_branch_of(element: Element) -> Pad | None:
    """The nearest src pad upstream of an element whose branch may be dropped, or None."""
    front = [element]
    seen: set[int] = set()
    while front:
        current = front.pop(0)
        if id(current) in seen:
            continue
        seen.add(id(current))
        for sink in current.sink_pads():
            if sink.peer is not None:
                if is_expendable(sink.peer):
                    return sink.peer
                front.append(sink.peer.element)
    return None


def end_branch(src: Pad) -> None:
    """Ends a branch at its next frame, in the feeding thread; later frames are counted as dropped."""

    def drop(frame: Frame) -> None:
        src.element.count_drop("branch dropped after its failure")

    def end(frame: Frame) -> None:
        with contextlib.suppress(FlowStop, StreamkitError):
            src.send_event(EOS)
        src.unlink()
        src.push = drop
        src.element.pads_changed()
        drop(frame)

    src.push = end
    src.element.pads_changed()


class BranchFailures:
    """Drops failed branches in one run of a graph.

    Args:
        graph: the graph.
        bus: gets a warning for each dropped branch.
        end: the sinks of a dropped branch are removed from it.
    """

    def __init__(self, graph: Graph, bus: Bus, end: StreamEnd) -> None:
        self._graph = graph
        self._bus = bus
        self._end = end
        self._lock = threading.Lock()
        self._dropped: set[int] = set()  # ids of sinks

    def reset(self) -> None:
        """Resets the state of an earlier run."""
        self._dropped = set()

    def guard(self, src: Pad) -> None:
        """Guards the branch behind a src pad if it may be dropped."""
        if not is_expendable(src):
            return
        push = src.push

        def push_guarded(frame: Frame) -> None:
            try:
                push(frame)
            except (ElementFailure, NotNegotiated) as error:
                if not self._drop(src, error):
                    raise
            except EndOfStream:  # failed behind a queue, or finished: others continue
                src.element.count_drop("branch has ended")

        src.push = push_guarded
        src.element.pads_changed()

    def drops(self, error: Exception) -> bool:
        """Drops the branch of a failed element; False if the pipeline fails."""
        if not isinstance(error, ElementFailure):
            return False
        failed = next((e for e in self._graph.elements if e.name == error.element), None)
        branch = None if failed is None else expendable_branch_of(failed)
        return branch is not None and self._drop(branch, error)

    def _drop(self, src: Pad, error: Exception) -> bool:
        """Drops a branch; False if no other sink would be left."""
        sinks = [element for element in downstream_elements(src) if isinstance(element, Sink)]
        every_sink = {id(element) for element in self._graph.elements if isinstance(element, Sink)}
        with self._lock:
            dropped = self._dropped | {id(sink) for sink in sinks}
            if not every_sink - dropped:
                return False
            is_first = dropped != self._dropped
            self._dropped = dropped
        if is_first:
            end_branch(src)
            source = error.element if isinstance(error, ElementFailure) else src.element.name
            text = f"the branch behind {src.path} is dropped, the others go on: {error}"
            fields = {"code": "branch-dropped", "branch": src.path}
            self._bus.post(Message(MessageKind.WARNING, source, text, fields, error))
            self._end.remove(sinks)
        return True
