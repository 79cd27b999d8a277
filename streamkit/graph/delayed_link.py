"""DelayedLink: a link that waits for a pad which the stream brings."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad
from streamkit.errors import DescriptionError, ElementFailure, NotNegotiated
from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.caps_conflict import CODED_VIDEO, RAW
from streamkit.graph.link import RAW_VIDEO, LinkRequest


@dataclass(slots=True)
class DelayedLink:
    """A link that is tried whenever its source adds a pad.

    Attributes:
        request: the link, whose source adds the pad.
        make: makes a link, with its caps filter.
        has_succeeded: whether it has linked a pad.
    """

    request: LinkRequest
    make: Callable[[LinkRequest], object]
    has_succeeded: bool = False

    @property
    def description(self) -> str:
        """The link as text."""
        request = self.request
        src = f"{request.source.name}.{request.src_name}"
        return f"{src} ! {request.sink.name}{'.' if request.sink_name else ''}{request.sink_name}"

    def try_link(self, pad: Pad) -> None:
        """Links a new pad if it matches."""
        request = self.request
        is_awaited = pad.element is request.source and pad.is_src and pad.peer is None
        is_named = request.src_name in ("", pad.name, pad.template.name)
        if is_awaited and is_named and (request.every_pad or not self.has_succeeded):
            with contextlib.suppress(DescriptionError):
                self.make(replace(request, src_name=pad.name))
                self.has_succeeded = True


def report_missing_pads(
    element: Element, links: Iterable[DelayedLink], post: Callable[[Message], None]
) -> None:
    """Warns of the links that wait for a pad of an element, which adds no more.

    Raises:
        ElementFailure: no pad of the element is linked, for example because a decoder is missing.
    """
    waiting = [
        link
        for link in links
        if link.request.source is element and not (link.has_succeeded or link.request.every_pad)
    ]
    if waiting and all(pad.peer is None for pad in element.src_pads()):
        raise ElementFailure(element.name, element.factory, _unlinked(element, waiting[0]))
    for link in waiting:
        text = f"the stream has no pad for {link.description}; {_pads_text(element)}"
        post(Message(MessageKind.WARNING, element.name, text, {"code": "delayed-link"}))


def _unlinked(element: Element, link: DelayedLink) -> NotNegotiated:
    """The error for an element of which the stream has no pad that fits the element downstream."""
    pads = list(element.src_pads())
    media = [pad.caps.name for pad in pads if pad.caps is not None and not pad.caps.is_any]
    # A live source has caps with its first packet only.
    possible = media or [item.name for pad in pads for item in pad.template.caps.structures]
    coded = next((name for name in possible if name.startswith(CODED_VIDEO)), RAW)
    takes_video = any(
        template.direction is Direction.SINK and template.caps.can_intersect(RAW_VIDEO)
        for template in link.request.sink.pad_templates.values()
    )
    if coded != RAW and takes_video and not link.request.src_name:
        sink = link.request.sink.name
        kind = f" ({coded})" if media else ""
        return NotNegotiated(
            f"gives coded packets{kind}, which {sink} does not take: put decode between, "
            f"{element.name} ! decode ! {sink}"
        )
    return NotNegotiated(
        f"none of its pads is linked: the stream has no pad for {link.description}; {_pads_text(element)}; "
        "insert an element that accepts them"
    )


def _pads_text(element: Element) -> str:
    """The src pads of an element with their media types, for a warning."""
    pads = [
        pad.name if pad.caps is None or pad.caps.is_any else f"{pad.name} with {pad.caps.name}"
        for pad in element.src_pads()
    ]
    return f"it has {', '.join(pads)}" if pads else "it has none at all"
