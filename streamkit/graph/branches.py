"""Branches of a graph that join and leave while it streams: `Pipeline.add_branch` and `remove_branch`."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad, Presence
from streamkit.errors import DescriptionError, ElementFailure
from streamkit.graph.bins import Bin
from streamkit.graph.files import FileConflict, check_files
from streamkit.graph.graph import Graph, free_name
from streamkit.graph.link import find_pad
from streamkit.graph.negotiate import negotiate, remember_caps

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


def add_branch(graph: Graph, name: str, description: str, playback: Playback | None) -> Branch:
    """Implements `Pipeline.add_branch`."""
    from streamkit.graph.build import build

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
    src.awaits_first_frame = playback is not None and playback.is_streaming
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
        if playback is not None:
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
            playback.adopt(element)
    if playback.is_streaming:
        remember_caps(graph)
        playback.join_branch(branch.src, branch.elements)


def remove_branch(graph: Graph, branch: Branch, playback: Playback | None, timeout_s: float) -> None:
    """Removes a branch after it has drained; its elements stay started."""
    if playback is not None and playback.is_streaming:
        deadline = time.monotonic() + timeout_s
        playback.branches.remove(branch.src, timeout_s)
        playback.end.wait(branch.elements, deadline - time.monotonic())
        playback.leave_branch(branch.src, branch.elements)
    _detach(graph, branch)
    if playback is not None and playback.is_streaming:
        remember_caps(graph)


def _detach(graph: Graph, branch: Branch) -> None:
    branch.src.element.release_pad(branch.src)
    graph.added_branches.discard(branch.src)
    graph.elements[:] = [element for element in graph.elements if element not in branch.elements]
    graph.inserted[:] = [element for element in graph.inserted if element not in branch.elements]
    graph.bins[:] = [group for group in graph.bins if group not in branch.bins]
