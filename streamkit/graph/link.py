"""Links: which pads two ends of a `!` mean, made in textual order."""

from __future__ import annotations

from collections.abc import Sequence

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad, Presence
from streamkit.element.suggest import did_you_mean
from streamkit.errors import DescriptionError, Place


def link_elements(
    source: Element, src_names: Sequence[str], sink: Element, sink_names: Sequence[str], place: Place
) -> list[tuple[Pad, Pad]]:
    """Links two elements by the pads named, or by the first that are free.

    Raises:
        DescriptionError: code `link`, or `no-such-pad` for a name that no template has.
    """
    if source is sink:
        raise DescriptionError("link", f"{source.name} cannot be linked to itself", place)
    if src_names and sink_names and len(src_names) != len(sink_names):
        raise DescriptionError(
            "link",
            f"{len(src_names)} pads of {source.name} cannot meet {len(sink_names)} pads of {sink.name}",
            place,
        )
    if src_names and sink_names:
        pairs = list(zip(src_names, sink_names, strict=True))
    else:
        pairs = [(src_names[0] if src_names else "", sink_names[0] if sink_names else "")]
    made = []
    for src_name, sink_name in pairs:
        src = find_pad(source, Direction.SRC, src_name, place)
        target = find_pad(sink, Direction.SINK, sink_name, place)
        src.link(target)
        made.append((src, target))
    return made


def find_pad(element: Element, direction: Direction, name: str, place: Place) -> Pad:
    """A free pad of an element: the one named, else the first that is there, else a new one on request.

    Raises:
        DescriptionError: there is none, or it is linked already.
    """
    if name:
        return _named_pad(element, direction, name, place)
    linked: list[str] = []
    for pad in element.pads.values():
        if pad.template.direction is direction:
            if pad.peer is None and pad.template.presence is Presence.ALWAYS:
                return pad
            linked.append(pad.name)
    for template in element.pad_templates.values():
        if template.direction is direction and template.presence is not Presence.ALWAYS:
            return element.request_pad(template)
    if linked:
        raise DescriptionError(
            "link",
            f"{element.name} has no free {direction} pad: {', '.join(linked)} is linked already",
            place,
            "put a tee before it to feed several elements" if direction is Direction.SRC else "",
        )  # fmt: skip
    kind = "sink" if direction is Direction.SINK else "source"
    raise DescriptionError("link", f"link has no {kind}: {element.name} has no {direction} pad", place)


def _named_pad(element: Element, direction: Direction, name: str, place: Place) -> Pad:
    pad = element.pads.get(name)
    if pad is None:
        for template in element.pad_templates.values():
            if template.direction is direction and (template.matches(name) or template.name == name):
                return element.request_pad(template, name)
        known = [*element.pads, *(template.name for template in element.pad_templates.values())]
        raise DescriptionError(
            "link", f"{element.name} has no pad {name!r}", place, did_you_mean(name, known)
        )
    if pad.template.direction is not direction:
        raise DescriptionError(
            "link", f"{pad.path} is a {pad.template.direction} pad, here a {direction} pad is needed", place
        )
    if pad.peer is not None:
        raise DescriptionError("link", f"{pad.path} is linked to {pad.peer.path} already", place)
    return pad
