"""Branches of a graph that join and leave while it streams, or fail alone.

A branch behind a tee whose sinks all have `on-error=drop-branch` fails alone.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from streamkit.element.base import Element
from streamkit.element.branching import Split
from streamkit.element.pad import Direction, Pad, Presence
from streamkit.element.pad_owner import walk
from streamkit.element.sink import OnError, Sink
from streamkit.errors import DescriptionError, ElementFailure, NotNegotiated, StreamkitError
from streamkit.flow.events import EOS, CapsEvent, EndOfStream, FlowStop, Flushing, SegmentEvent
from streamkit.flow.frame import Frame
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.bins import Bin
from streamkit.graph.files import FileConflict, check_files
from streamkit.graph.graph import Graph, free_name
from streamkit.graph.link import find_pad
from streamkit.graph.negotiate import negotiate, remember_caps
from streamkit.graph.streaming import State

if TYPE_CHECKING:
    from streamkit.graph.playback import Playback


@dataclass(frozen=True, slots=True)
class Branch:
    """A description linked to a request pad.

    Attributes:
        src: the request pad.
        elements: its elements, including inserted converters.
        bins: the bins in it.
    """

    src: Pad
    elements: list[Element]
    bins: list[Bin]


def add_branch(playback: Playback, name: str, description: str) -> Branch:
    """Implements `Pipeline.add_branch`."""
    from streamkit.graph.build import build

    graph, state = playback.pipeline.graph, playback.pipeline.state
    element = graph.element(name)
    taken = {known.name for known in (*graph.elements, *graph.bins)}
    added = build(description, {}, taken)
    _check_links(graph, element, added)
    _check_names(added, taken)
    entry = find_pad(added.elements[0], Direction.SINK)
    src = find_pad(element, Direction.SRC)
    if src.template.presence is not Presence.REQUEST:
        raise DescriptionError("link", f"{name} makes no pads on request; put a tee there: tee name=t")
    # No event before its elements have started.
    src.awaits_first_frame = state.is_streaming
    src.link(entry)
    graph.added_branches.add(src)
    before = len(graph.inserted)
    graph.elements += added.elements
    graph.bins += added.bins
    branch = Branch(src, list(added.elements), added.bins)
    try:
        _check_files(graph)
        try:
            negotiate(graph, {})
        finally:
            branch.elements.extend(graph.inserted[before:])
        if state is not State.NULL:
            _start(graph, branch, playback)
    except (DescriptionError, ElementFailure):
        _detach(graph, branch)
        raise
    return branch


def _check_links(graph: Graph, element: Element, added: Graph) -> None:
    """Refuses a branch that begins or leads outside of the main process, or waits for a pad."""
    if added.homes or not graph.is_local(element):
        raise DescriptionError("link", f"{element.name}: branches join and leave in the main process only")
    for delayed in added.delayed_links:
        raise DescriptionError(
            "link",
            f"{delayed.description}: a branch cannot wait for a pad that the stream adds later; put "
            f"{delayed.request.source.name} into the pipeline, and a tee behind it",
        )


def _check_files(graph: Graph) -> None:
    try:
        check_files(graph)
    except FileConflict as error:
        raise DescriptionError("could-not-set-property", str(error)) from None


def _check_names(added: Graph, taken: set[str]) -> None:
    """Refuses names that are already in use; renumbers inserted converters."""
    for element in (*added.bins, *added.elements):
        if element in added.inserted:
            element.name = free_name(element.factory, taken)
        elif element.name in taken:
            raise DescriptionError("link", f"the pipeline has an element {element.name!r} already")
        taken.add(element.name)


def _start(graph: Graph, branch: Branch, playback: Playback) -> None:
    for element in graph.from_sinks():
        if element in branch.elements:
            playback.pipeline.adopt(element)
    if playback.pipeline.state.is_streaming:
        remember_caps(graph)
        playback.join_branch(branch.src, branch.elements)


def remove_branch(playback: Playback, branch: Branch, timeout_s: float) -> None:
    """Removes a branch after it has drained; its elements stay started."""
    graph, is_streaming = playback.pipeline.graph, playback.pipeline.state.is_streaming
    if is_streaming:
        deadline = time.monotonic() + timeout_s
        playback.branches.remove(branch.src, timeout_s)
        playback.end.wait(branch.elements, deadline - time.monotonic())
        playback.leave_branch(branch.src, branch.elements)
    _detach(graph, branch)
    if is_streaming:
        remember_caps(graph)


def _detach(graph: Graph, branch: Branch) -> None:
    branch.src.element.release_pad(branch.src)
    graph.added_branches.discard(branch.src)
    graph.elements[:] = [element for element in graph.elements if element not in branch.elements]
    graph.inserted[:] = [element for element in graph.inserted if element not in branch.elements]
    graph.bins[:] = [group for group in graph.bins if group not in branch.bins]


class BranchOutput:
    """Sends the frames of a src pad into the branch behind it, until it is removed or has failed.

    Args:
        src: the first pad of the branch; its `push` becomes this object's.
        send: pushes a frame into the branch.
        drop: drops the branch for its failure; returns False if the pipeline has to fail.
    """

    def __init__(
        self, src: Pad, send: Callable[[Frame], None], drop: Callable[[Pad, Exception], bool]
    ) -> None:
        self._src, self._send, self._drop = src, send, drop
        self._entry = src.peer
        self._is_removed = self._has_failed = False
        self._sending = threading.RLock()  # held while a frame or EOS is on its way into the branch
        src.push = self.push

    def push(self, frame: Frame) -> None:
        """Sends a frame; a failed branch gets EOS in place of its first, and each counts as dropped."""
        with self._sending:
            if self._src.awaits_first_frame:
                self._join(frame)
            if self._is_closed():
                self._end()
                if self._has_failed:
                    self._src.element.count_drop("branch dropped after its failure")
                return
            try:
                self._send(frame)
            except (ElementFailure, NotNegotiated) as error:
                if not self._drop(self._src, error):
                    raise
            except EndOfStream:  # failed behind a queue, or finished
                if not is_expendable(self._src):
                    raise
                self._src.element.count_drop("branch has ended")
            except Flushing:
                if not self._is_removed:
                    raise
                self._src.element.count_drop("branch was removed")

    def remove(self, timeout_s: float) -> None:
        """Ends the branch: EOS goes out behind the frame on its way, which has `timeout_s` to arrive."""
        self._is_removed = True
        failures: list[Exception] = []

        def end() -> None:
            try:
                with self._sending:
                    self._end()
            except Exception as failure:
                failures.append(failure)

        # A sink without a queue takes EOS in this thread, and waits with it while the pipeline is paused.
        thread = threading.Thread(target=end, name=f"streamkit:{self._src.path}:end")
        thread.start()
        thread.join(max(0.0, timeout_s))
        if failures:
            raise failures[0]

    def fail(self) -> None:
        """Ends the branch at its next frame; the frames that follow are counted as dropped."""
        self._has_failed = True

    def relink(self) -> None:
        """Links a branch that has failed again, for the next run."""
        if self._entry is not None and self._src.peer is None:
            self._src.link(self._entry)

    def _is_closed(self) -> bool:
        return self._is_removed or self._has_failed

    def _join(self, frame: Frame) -> None:
        src = self._src
        src.awaits_first_frame = False
        src.send_event(CapsEvent(frame.caps))
        above = next(src.element.sink_pads(), None)
        if above is not None:
            src.send_event(SegmentEvent(above.segment))

    def _end(self) -> None:
        src = self._src
        try:
            if not src.is_eos:
                src.send_event(EOS)
        except FlowStop:
            pass  # other branches go on
        except StreamkitError:
            if not self._has_failed:
                raise
        if self._has_failed:
            src.unlink()
            src.push = self.push


class BranchOutputs:
    """Outputs of one run whose branches join, leave or may fail alone; other pads push into their chain."""

    def __init__(self, playback: Playback) -> None:
        self._playback, self._graph = playback, playback.pipeline.graph
        self._lock = threading.Lock()
        self._outputs: dict[Pad, BranchOutput] = {}
        self._dropped: set[Element] = set()  # sinks

    def open(self) -> None:
        """Opens the branches that may be dropped or removed."""
        for element in self._graph.local():
            for src in list(element.src_pads()):
                src.awaits_first_frame = False
                if src in self._graph.added_branches or is_expendable(src):
                    self._output(src)

    def join(self, src: Pad, send: Callable[[Frame], None]) -> None:
        """Opens a branch whose pad awaits its first frame."""
        self._outputs[src] = BranchOutput(src, send, self._drop)

    def remove(self, src: Pad, timeout_s: float) -> None:
        """Ends a branch; no frame follows."""
        output = self._outputs.pop(src, None)
        if output is not None:
            output.remove(timeout_s)

    def relink(self) -> None:
        """Links the branches that have failed again, for the next run."""
        for output in self._outputs.values():
            output.relink()

    def drop_branch_of(self, error: Exception) -> bool:
        """Drops the branch of a failed element; False if the pipeline fails."""
        if not isinstance(error, ElementFailure):
            return False
        # A process that dies while none of its elements is at work has the name of its bin.
        failed = next((e for e in self._graph.elements if error.element in (e.name, e.parent)), None)
        branch = None if failed is None else expendable_branch_of(failed)
        return branch is not None and self._drop(branch, error)

    def _output(self, src: Pad) -> BranchOutput:
        with self._lock:
            if src not in self._outputs:
                self._outputs[src] = BranchOutput(src, src.push, self._drop)
            return self._outputs[src]

    def _drop(self, src: Pad, error: Exception) -> bool:
        """Drops a branch; False if it may not fail alone, or no other sink would be left."""
        if not is_expendable(src):
            return False
        sinks = sinks_behind(src)
        every_sink = {element for element in self._graph.elements if isinstance(element, Sink)}
        with self._lock:
            dropped = self._dropped.union(sinks)
            if not every_sink - dropped:
                return False
            is_first = dropped != self._dropped
            self._dropped = dropped
        if is_first:
            self._output(src).fail()
            source = error.element if isinstance(error, ElementFailure) else src.element.name
            text = f"the branch behind {src.path} is dropped, the others continue: {error}"
            fields = {"code": "branch-dropped", "branch": src.path}
            self._playback.pipeline.bus.post(Message(MessageKind.WARNING, source, text, fields, error))
            self._playback.end.remove(sinks)
        return True


def sinks_behind(src: Pad) -> list[Sink]:
    """Every sink downstream of a src pad."""
    first = [] if src.peer is None else [src.peer.element]
    return [element for element in walk(first, Element.downstream) if isinstance(element, Sink)]


def is_expendable(src: Pad) -> bool:
    """Whether the branch behind a src pad of a tee may be dropped."""
    if not isinstance(src.element, Split):
        return False
    sinks = sinks_behind(src)
    return bool(sinks) and all(sink.on_error is OnError.DROP_BRANCH for sink in sinks)


def expendable_branch_of(element: Element) -> Pad | None:
    """The nearest src pad upstream of an element whose branch may be dropped, or None."""
    peers = (sink.peer for nearest in walk([element], Element.upstream) for sink in nearest.sink_pads())
    return next((src for src in peers if src is not None and is_expendable(src)), None)
