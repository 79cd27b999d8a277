"""Branches that may fail: behind a tee, one whose sinks all say `on-error=drop-branch` ends alone."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from streamkit.element.base import Element
from streamkit.element.branching import Split
from streamkit.element.pad import Pad
from streamkit.element.sink import OnError, Sink
from streamkit.errors import ElementFailure, NotNegotiated, StreamkitError
from streamkit.flow.events import EOS
from streamkit.flow.frame import Frame
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.signals import EndOfStream, FlowStop
from streamkit.graph.bus import Bus
from streamkit.graph.graph import Graph
from streamkit.graph.stream_end import StreamEnd


def elements_behind(src: Pad) -> Iterator[Element]:
    """Every element that frames from a src pad can reach, each once."""
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
    """Whether the branch behind a src pad of a tee may fail without the pipeline."""
    if not isinstance(src.element, Split):
        return False
    sinks = [element for element in elements_behind(src) if isinstance(element, Sink)]
    return bool(sinks) and all(sink.on_error is OnError.DROP_BRANCH for sink in sinks)


def expendable_branch_of(element: Element) -> Pad | None:
    """The nearest src pad upstream of an element whose branch may fail; None where there is none."""
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
    """Ends a branch with its next frame, in the thread that feeds it; later frames count as dropped."""

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
    """Drops branches that fail and may, in one run of a graph.

    Args:
        graph: its elements.
        bus: takes a warning for each branch that is dropped.
        end: is told of the sinks that are gone.
    """

    def __init__(self, graph: Graph, bus: Bus, end: StreamEnd) -> None:
        self._graph = graph
        self._bus = bus
        self._end = end
        self._lock = threading.Lock()
        self._dropped: set[int] = set()  # sinks by `id`

    def reset(self) -> None:
        """A new run begins."""
        self._dropped = set()

    def guard(self, src: Pad) -> None:
        """Lets the branch behind a src pad fail alone, if its sinks say so."""
        if not is_expendable(src):
            return
        push = src.push

        def push_guarded(frame: Frame) -> None:
            try:
                push(frame)
            except (ElementFailure, NotNegotiated) as error:
                if not self._drop(src, error):
                    raise
            except EndOfStream:  # it has failed behind a queue, or wants no more: no reason to end others
                src.element.count_drop("branch has ended")

        src.push = push_guarded
        src.element.pads_changed()

    def drops(self, error: Exception) -> bool:
        """Drops the branch in which an element failed; False where the error is the pipeline's."""
        if not isinstance(error, ElementFailure):
            return False
        failed = next((e for e in self._graph.elements if e.name == error.element), None)
        branch = None if failed is None else expendable_branch_of(failed)
        return branch is not None and self._drop(branch, error)

    def _drop(self, src: Pad, error: Exception) -> bool:
        """Drops a branch; False where no other sink would be left."""
        sinks = [element for element in elements_behind(src) if isinstance(element, Sink)]
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
