"""Branches: descriptions added to and removed from a graph, also while it streams."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad, Presence
from streamkit.errors import DescriptionError, ElementFailure, Place
from streamkit.flow.events import EOS, CapsEvent, SegmentEvent
from streamkit.flow.frame import Frame
from streamkit.graph.graph import Graph
from streamkit.graph.link import find_pad
from streamkit.graph.negotiate import negotiate, remember_caps

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
        negotiate(graph, {})
        branch.elements.extend(graph.inserted[before:])
        if playback is not None:
            _start(graph, branch, playback)
    except (DescriptionError, ElementFailure):
        branch.elements.extend(graph.inserted[before:])
        _detach(graph, branch)
        raise
    return branch


def _rename(added: Graph, taken: set[str]) -> None:
    """Renumbers automatic names that are already in use."""
    for element in added.elements:
        if element.name not in taken:
            taken.add(element.name)
            continue
        plain = element.factory.replace("-", "")
        if not re.fullmatch(re.escape(plain) + r"-?\d+", element.name):
            raise DescriptionError("link", f"the pipeline has an element {element.name!r} already")
        number = 0
        while f"{plain}{number}" in taken:
            number += 1
        element.name = f"{plain}{number}"
        taken.add(element.name)


def _start(graph: Graph, branch: Branch, playback: Playback) -> None:
    members = {id(element) for element in branch.elements}
    for element in graph.from_sinks():
        if id(element) in members:
            playback.adopt(element)
    if playback.is_streaming:
        remember_caps(graph)
        playback.join_branch(branch.src, branch.elements)


def remove_branch(graph: Graph, branch: Branch, playback: Playback | None, timeout_s: float) -> None:
    """Removes a branch after it has drained; its elements stay started."""
    if playback is not None and playback.is_streaming:
        _close(branch.src)
        playback.end.wait(branch.elements, time.monotonic() + timeout_s)
        playback.leave_branch(branch.src, branch.elements)
    _detach(graph, branch)
    if playback is not None and playback.is_streaming:
        remember_caps(graph)


def _close(src: Pad) -> None:
    """Sends EOS into the branch in the feeding thread, so that no frame follows."""
    closed = threading.Event()

    def close(frame: Frame | None) -> None:
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
    members = {id(element) for element in branch.elements}
    graph.elements[:] = [element for element in graph.elements if id(element) not in members]
    graph.inserted[:] = [element for element in graph.inserted if id(element) not in members]
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
