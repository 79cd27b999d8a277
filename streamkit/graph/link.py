"""Links: selects the pads for a `!`, and says in words why none fit, or that one is missing."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.errors import DescriptionError, Place, StreamkitError, did_you_mean
from streamkit.flow.caps import Caps
from streamkit.flow.video import (
    conversion_remedy,
    is_raw_video,
    misspelt_fields,
    misspelt_formats,
    misspelt_media,
)
from streamkit.graph.graph import Graph

RAW = "video/x-raw"
CODED_VIDEO = ("video/", "image/")  # begin the media types of coded packets
MEDIA_SHOWN = 3
RAW_VIDEO = Caps(RAW)
Choice = Pad | PadTemplate


@dataclass(frozen=True, slots=True)
class LinkRequest:
    """A link of a description: two elements, the pad named on each or "", and the caps filter between them.

    Attributes:
        place, src_place, sink_place: in the text, of the link and of the pads' names, where they have any.
        every_pad: whether it links every new pad of the source.
    """

    source: Element
    src_name: str
    sink: Element
    sink_name: str
    place: Place
    src_place: Place | None = None
    sink_place: Place | None = None
    caps: Caps | None = None
    every_pad: bool = False


def choose_pads(request: LinkRequest, *, strict: bool = False) -> tuple[Pad, Pad]:
    """The pads of a link: those named, else the first free or requested pads that fit.

    If there is only one choice, caps are left to negotiation, unless `strict`.

    Raises:
        DescriptionError: code `link`; pads requested here are released.
    """
    source, sink, place = request.source, request.sink, request.place
    if source is sink:
        raise DescriptionError("link", f"{source.name} cannot be linked to itself", place)
    before = {*source.pads.values(), *sink.pads.values()}
    try:
        srcs = _choices(source, Direction.SRC, request.src_name, request.src_place or place)
        sinks = _choices(sink, Direction.SINK, request.sink_name, request.sink_place or place)
        src_choice, sink_choice = _pair(request, list(srcs), list(sinks), strict)
        return _pad(source, src_choice), _pad(sink, sink_choice)
    except StreamkitError as error:
        for pad in {*source.pads.values(), *sink.pads.values()} - before:
            pad.element.release_pad(pad)
        if isinstance(error, DescriptionError):
            raise
        raise DescriptionError("link", str(error), place) from None


def find_pad(element: Element, direction: Direction) -> Pad:
    """The first free pad of an element, else a new request pad.

    Raises:
        DescriptionError: there is none.
    """
    for choice in _choices(element, direction, "", Place()):
        return _pad(element, choice)
    raise _nothing_free(element, direction, Place())


def _pair(
    request: LinkRequest, srcs: list[Choice], sinks: list[Choice], strict: bool
) -> tuple[Choice, Choice]:
    """The first pair that fits: pads before templates, in the source's order before the sink's."""
    if not srcs:
        raise _nothing_free(request.source, Direction.SRC, request.place)
    if not sinks:
        raise _nothing_free(request.sink, Direction.SINK, request.place)
    if not strict and len(srcs) == len(sinks) == 1 and not awaits_pads(request.source):
        return srcs[0], sinks[0]
    # Existing pads come before pads to be requested, on the source's side first, even with a converter.
    pairs = sorted(((src, sink) for src in srcs for sink in sinks), key=_requested)
    for _, group in groupby(pairs, _requested):
        alike = list(group)
        for fits in (Caps.can_intersect,) if strict else (Caps.can_intersect, are_convertible):
            for src, sink in alike:
                if fits(_caps(src), _caps(sink)):
                    return src, sink
    left, right = f"{request.source.name}.{srcs[0].name}", f"{request.sink.name}.{sinks[0].name}"
    raise caps_conflict(left, _caps(srcs[0]), right, _caps(sinks[0]), request.place, request.sink)


def _requested(pair: tuple[Choice, Choice]) -> tuple[bool, bool]:
    """Whether the src and the sink pad of a pair are to be requested."""
    src, sink = pair
    return not isinstance(src, Pad), not isinstance(sink, Pad)


def awaits_pads(element: Element) -> bool:
    """Whether the stream may add src pads later."""
    return any(
        template.presence is Presence.SOMETIMES and template.direction is Direction.SRC
        for template in element.pad_templates.values()
    )


def check_names(request: LinkRequest) -> None:
    """Checks that the pads that a link names may come to be, whatever the stream adds.

    Raises:
        DescriptionError: code `link`; no pad of the element can have the name.
    """
    for element, direction, name, place in (
        (request.source, Direction.SRC, request.src_name, request.src_place),
        (request.sink, Direction.SINK, request.sink_name, request.sink_place),
    ):
        templates = [each for each in element.pad_templates.values() if each.direction is direction]
        is_possible = any(each.matches(name) or each.name == name for each in templates)
        if name and name not in element.pads and not is_possible:
            raise _no_such_pad(element, name, place or request.place)


def _choices(element: Element, direction: Direction, name: str, place: Place) -> Iterator[Choice]:
    """The pad of a name, else free pads, then templates of request pads."""
    if name:
        yield _named(element, direction, name, place)
        return
    for pad in list(element.pads.values()):
        if pad.template.direction is direction and pad.peer is None:
            yield pad
    for template in element.pad_templates.values():
        if template.direction is direction and template.presence is Presence.REQUEST:
            yield template


def _caps(choice: Choice) -> Caps:
    if not isinstance(choice, Pad):
        return choice.caps
    with contextlib.suppress(RecursionError):  # a loop of links
        found = choice.query_caps()
        if not found.is_empty:  # else a converter will be inserted upstream, or negotiation fails
            return found
    return choice.template.caps


def _pad(element: Element, choice: Choice) -> Pad:
    """A chosen pad, which is made of a template."""
    return choice if isinstance(choice, Pad) else element.request_pad(choice)


def are_convertible(offered: Caps, accepted: Caps) -> bool:
    """Whether caps conflict in the format of raw video only, so that negotiation inserts a converter."""
    raw = offered.without_fields("format") & RAW_VIDEO
    return raw.can_intersect(accepted.without_fields("format"))


def _named(element: Element, direction: Direction, name: str, place: Place) -> Pad:
    """The pad of a name, which is made of a template if it is not there."""
    pad = element.pads.get(name)
    if pad is None:
        for template in element.pad_templates.values():
            fits = template.matches(name) or template.name == name
            if template.direction is direction and template.presence is not Presence.ALWAYS and fits:
                if template.presence is Presence.SOMETIMES and "%u" in template.name:
                    continue
                return element.request_pad(template, name)
        raise _no_such_pad(element, name, place)
    if pad.template.direction is not direction:
        raise DescriptionError(
            "link", f"{pad.path} is a {pad.template.direction} pad, here a {direction} pad is needed", place
        )
    if pad.peer is not None:
        raise DescriptionError("link", f"{pad.path} is linked to {pad.peer.path} already", place)
    return pad


def _no_such_pad(element: Element, name: str, place: Place) -> DescriptionError:
    known = dict.fromkeys([*element.pads, *(each.name for each in element.pad_templates.values())])
    hint = did_you_mean(name, known) or f"it has {', '.join(known) or 'none'}"
    return DescriptionError("link", f"{element.name} has no pad {name!r}", place, hint)


def _nothing_free(element: Element, direction: Direction, place: Place) -> DescriptionError:
    linked = [pad.name for pad in element.pads.values() if pad.template.direction is direction]
    if linked:
        return DescriptionError(
            "link",
            f"{element.name} has no free {direction} pad: {', '.join(linked)} is linked already",
            place,
            "put a tee before it to feed several elements" if direction is Direction.SRC else "",
        )
    kind = "sink" if direction is Direction.SINK else "source"
    return DescriptionError("link", f"link has no {kind}: {element.name} has no {direction} pad", place)


def caps_conflict(
    left: str, offered: Caps, right: str, accepted: Caps, place: Place | None, sink: Element
) -> DescriptionError:
    """The error for two pads, by path, whose caps have nothing in common; `sink` is the second's element."""
    text = f"could not link {left} to {right}: they "
    misspelt = dict.fromkeys([*misspelt_media(offered), *misspelt_media(accepted)])
    if remedy := "; ".join(misspelt) or _codec_remedy(offered, accepted, sink):
        text += f"disagree on media type: {left} offers {_media(offered)}; {right} takes {_media(accepted)}"
        return DescriptionError("link", text, place, remedy)
    text += offered.disagreement(accepted, left, right)
    fields = [*misspelt_fields(offered), *misspelt_fields(accepted)]
    formats = [*misspelt_formats(offered), *misspelt_formats(accepted)]
    hints = dict.fromkeys(fields + formats)
    return DescriptionError("link", text, place, "; ".join(hints) or conversion_remedy(offered, accepted))


def _codec_remedy(offered: Caps, accepted: Caps, sink: Element) -> str:
    """What to change where raw video meets an element for coded packets, or the other way; "" elsewhere."""
    if is_raw_video(offered) and _is_coded_video(accepted):
        converter, done = "encode", "decoded"
    elif _is_coded_video(offered) and is_raw_video(accepted):
        converter, done = "decode", "encoded"
    else:
        return ""
    made = [template.caps for template in sink.pad_templates.values() if template.direction is Direction.SRC]
    if any(not caps.is_any and offered.can_intersect(caps) for caps in made):
        return f"the video is {done} before {sink.name}: leave {sink.name} out"
    return f"put {converter} between"


def _is_coded_video(caps: Caps) -> bool:
    names = {structure.name for structure in caps.structures}
    return bool(names) and RAW not in names and all(name.startswith(CODED_VIDEO) for name in names)


def _media(caps: Caps) -> str:
    """The media types of caps; of many, the first."""
    names = list(dict.fromkeys(structure.name for structure in caps.structures))
    left_out = len(names) - MEDIA_SHOWN
    return ", ".join(names[:MEDIA_SHOWN]) + (f" and {left_out} others" if left_out > 0 else "")


def open_ends(graph: Graph) -> Iterator[str]:
    """A note for each."""
    for element in graph.elements:
        if element.factory == "appsink":
            effect = "drops frames" if getattr(element, "drop", False) else "fills up"
            yield f"{element.name} {effect}, as only a Python program takes its frames; write fakesink here"
        elif element.factory == "appsrc":
            yield f"{element.name} waits, as only a Python program gives it frames; write fakesrc here"
        outputs = list(element.src_pads())
        # Those on request follow the element's own, and are made when they are linked.
        if outputs and any(element.sink_pads()) and outputs[0].peer is None:
            yield f"{outputs[0].path} is not linked, its frames go nowhere; link it to a sink"
        if not graph.delayed_links:
            yield from _missing_input(element)


def _missing_input(element: Element) -> Iterator[str]:
    """A note if no frame can come: the pad `sink` is not linked, or no input was requested."""
    sink = element.pads.get("sink")
    if sink is not None and sink.peer is None:
        takes_video = not sink.template.caps.is_any and sink.template.caps.can_intersect(RAW_VIDEO)
        source = "filesrc location=FILE ! decode" if takes_video else "a source"
        yield f"{sink.path} is not linked, no frame comes; write {source} ! before {element.factory}"
    templates = element.pad_templates.values()
    if not any(element.sink_pads()) and any(item.direction is Direction.SINK for item in templates):
        yield f"{element.name} has no input, no frame comes; write a source ! {element.name}."
