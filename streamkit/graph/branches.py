"""Branches of a graph: added and removed while it streams, and dropped after a failure.

A branch behind a tee whose sinks all have `on-error=drop-branch` ends alone.
"""

from __future__ import annotations

import contextlib
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from streamkit.element.base import Element
from streamkit.element.branching import Split
from streamkit.element.pad import Direction, Pad, Presence
from streamkit.element.sink import OnError, Sink
from streamkit.errors import DescriptionError, ElementFailure, NotNegotiated, Place, StreamkitError
from streamkit.flow.events import EOS, CapsEvent, EndOfStream, FlowStop, SegmentEvent
from streamkit.flow.frame import Frame
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.bus import Bus
from streamkit.graph.files import FileConflict, check_files
from streamkit.graph.graph import Graph, downstream, free_name, upstream, walk
from streamkit.graph.link import find_pad
from streamkit.graph.negotiate import negotiate, remember_caps
from streamkit.graph.stream_end import StreamEnd

if TYPE_CHECKING:
    from streamkit.graph.playback import Playback

NOWHERE = Place()
IDLE_S = 0.5  # without a frame for this time, nothing is in flight to a branch


@dataclass(frozen=True, slots=True)
class Branch:
    """A description linked to a request pad.

    Attributes:
        src: the request pad.
        elements: its elements, including inserted converters.
    """

    src: Pad
    elements: list[Element]


def add_branch(graph: Graph, name: str, description: str, playback: Playback | None) -> Branch:
    """Implements `Pipeline.add_branch`."""
    from streamkit.graph.build import build

    element = graph.element(name)
    added = build(description, {})
    if added.homes or not graph.is_local(element):
        raise DescriptionError("link", f"{name}: branches join and leave in the main process only")
    _rename(added, {known.name for known in graph.elements})
    entry = find_pad(added.elements[0], Direction.SINK, "", NOWHERE)
    src = find_pad(element, Direction.SRC, "", NOWHERE)
    if src.template.presence is not Presence.REQUEST:
        raise DescriptionError("link", f"{name} makes no pads on request; put a tee there: tee name=t")
    src.awaits_first_frame = (
        playback is not None and playback.is_streaming
    )  # no event before its elements have started
    src.link(entry)
    before = len(graph.inserted)
    graph.elements += added.elements
    graph.bins += added.bins
    branch = Branch(src, list(added.elements))
    try:
        check_files(graph.elements)
        negotiate(graph, {})
        branch.elements.extend(graph.inserted[before:])
        if playback is not None:
            _start(graph, branch, playback)
    except (DescriptionError, ElementFailure, FileConflict) as error:
        branch.elements.extend(graph.inserted[before:])
        _detach(graph, branch)
        if isinstance(error, FileConflict):
            raise DescriptionError("could-not-set-property", str(error)) from None
        raise
    return branch


def _rename(added: Graph, taken: set[str]) -> None:
    """Renumbers automatic names that are already in use."""
    for element in added.elements:
        if element.name in taken:
            plain = element.factory.replace("-", "")
            if not re.fullmatch(re.escape(plain) + r"-?\d+", element.name):
                raise DescriptionError("link", f"the pipeline has an element {element.name!r} already")
            element.name = free_name(element.factory, taken)
        taken.add(element.name)


def _start(graph: Graph, branch: Branch, playback: Playback) -> None:
    for element in graph.from_sinks():
        if element in branch.elements:
            playback.adopt(element)
    if playback.is_streaming:
        remember_caps(graph)
        playback.join_branch(branch.src, branch.elements)


def remove_branch(graph: Graph, branch: Branch, playback: Playback | None, timeout_s: float) -> None:
    """Removes a branch after it has drained; its elements stay started."""
    if playback is not None and playback.is_streaming:
        _close(branch.src)
        playback.end.wait(branch.elements, timeout_s)
        playback.leave_branch(branch.src, branch.elements)
    _detach(graph, branch)
    if playback is not None and playback.is_streaming:
        remember_caps(graph)


def _close(src: Pad) -> None:
    """Sends EOS into the branch in the feeding thread, so that no frame follows."""
    closed = threading.Event()

    def close(_: Frame | None) -> None:
        if not closed.is_set():
            closed.set()
            src.is_eos = True
            src.send_event(EOS)

    src.push = close
    src.element.pads_changed()
    if not closed.wait(IDLE_S) and not src.is_eos:
        close(None)


def _detach(graph: Graph, branch: Branch) -> None:
    branch.src.element.release_pad(branch.src)
    branch.src.element.pads_changed()
    graph.elements[:] = [element for element in graph.elements if element not in branch.elements]
    graph.inserted[:] = [element for element in graph.inserted if element not in branch.elements]
    parents = {element.parent for element in branch.elements} - {e.parent for e in graph.elements}
    graph.bins[:] = [group for group in graph.bins if group.name not in parents]


def first_push(src: Pad, push: Callable[[Frame], None]) -> Callable[[Frame], None]:
    """A push function that sends caps and segment before the first frame of a new branch."""

    def begin(frame: Frame) -> None:
        src.awaits_first_frame = False
        src.send_event(CapsEvent(frame.caps))
        upstream = next(src.element.sink_pads(), None)
        if upstream is not None:
            src.send_event(SegmentEvent(upstream.segment))
        src.push = push
        src.element.pads_changed()
        push(frame)

    src.awaits_first_frame = True
    return begin


def sinks_behind(src: Pad) -> list[Sink]:
    """Every sink downstream of a src pad."""
    first = [] if src.peer is None else [src.peer.element]
    return [element for element in walk(first, downstream) if isinstance(element, Sink)]


def is_expendable(src: Pad) -> bool:
    """Whether the branch behind a src pad of a tee may be dropped."""
    if not isinstance(src.element, Split):
        return False
    sinks = sinks_behind(src)
    return bool(sinks) and all(sink.on_error is OnError.DROP_BRANCH for sink in sinks)


def expendable_branch_of(element: Element) -> Pad | None:
    """The nearest src pad upstream of an element whose branch may be dropped, or None."""
    peers = (sink.peer for nearest in walk([element], upstream) for sink in nearest.sink_pads())
    return next((src for src in peers if src is not None and is_expendable(src)), None)


def end_branch(src: Pad) -> None:
    """Ends a branch at its next frame, in the feeding thread; later frames are counted as dropped."""

    def drop(_: Frame) -> None:
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
        self._dropped: set[Element] = set()  # sinks

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
        sinks = sinks_behind(src)
        every_sink = {element for element in self._graph.elements if isinstance(element, Sink)}
        with self._lock:
            dropped = self._dropped.union(sinks)
            if not every_sink - dropped:
                return False
            is_first = dropped != self._dropped
            self._dropped = dropped
        if is_first:
            end_branch(src)
            source = error.element if isinstance(error, ElementFailure) else src.element.name
            text = f"the branch behind {src.path} is dropped, the others continue: {error}"
            fields = {"code": "branch-dropped", "branch": src.path}
            self._bus.post(Message(MessageKind.WARNING, source, text, fields, error))
            self._end.remove(sinks)
        return True
