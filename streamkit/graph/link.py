"""Links: selects the pads for a `!`; delayed links wait for sometimes pads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from streamkit.element.base import Element
from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.errors import DescriptionError, Place, StreamkitError, did_you_mean
from streamkit.flow.caps import Caps

RAW_VIDEO = Caps("video/x-raw")


class LinkRequest(NamedTuple):
    """The two elements of a link, the pad named on each or "", and the place in the text."""

    source: Element
    src_name: str
    sink: Element
    sink_name: str
    place: Place
    src_place: Place | None = None  # of the pads' names, where they have any
    sink_place: Place | None = None


def pad_pairs(
    source: Element, src_names: Sequence[str], sink: Element, sink_names: Sequence[str], place: Place
) -> list[LinkRequest]:
    """The links of a `!` with lists of pads; raises `DescriptionError` if the lists differ in length."""
    if not (src_names and sink_names):
        return [LinkRequest(source, "".join(src_names[:1]), sink, "".join(sink_names[:1]), place)]
    if len(src_names) != len(sink_names):
        raise DescriptionError(
            "link",
            f"{len(src_names)} pads of {source.name} cannot meet {len(sink_names)} pads of {sink.name}",
            place,
        )
    pairs = zip(src_names, sink_names, strict=True)
    return [LinkRequest(source, src_name, sink, sink_name, place) for src_name, sink_name in pairs]


def choose_pads(request: LinkRequest, *, strict: bool = False) -> tuple[Pad, Pad]:
    """The pads of a link: those named, else the first free or requested pads that fit.

    If there is only one choice, caps are left to negotiation, unless `strict`.

    Raises:
        DescriptionError: code `link`; pads requested here are released.
    """
    source, src_name, sink, sink_name, place, src_place, sink_place = request
    if source is sink:
        raise DescriptionError("link", f"{source.name} cannot be linked to itself", place)
    made: list[Pad] = []
    try:
        srcs = [_named(source, Direction.SRC, src_name, src_place or place, made)] if src_name else None
        sinks = [_named(sink, Direction.SINK, sink_name, sink_place or place, made)] if sink_name else None
        src_choice, sink_choice = _pair(request, srcs, sinks, strict)
        return _pad(source, src_choice, made), _pad(sink, sink_choice, made)
    except StreamkitError as error:
        for pad in made:
            pad.element.release_pad(pad)
        if isinstance(error, DescriptionError):
            raise
        raise DescriptionError("link", str(error), place) from None


def find_pad(element: Element, direction: Direction, name: str, place: Place) -> Pad:
    """A free pad of an element: the one named, else the first free one, else a new request pad.

    Raises:
        DescriptionError: there is none, or it is linked already.
    """
    if name:
        return _named(element, direction, name, place, [])
    for choice in _choices(element, direction):
        return choice if isinstance(choice, Pad) else element.request_pad(choice)
    raise _nothing_free(element, direction, place)


def _pair(
    request: LinkRequest, srcs: list[Pad] | None, sinks: list[Pad] | None, strict: bool
) -> tuple[Pad | PadTemplate, Pad | PadTemplate]:
    """The first pair that fits: pads before templates, in the source's order before the sink's."""
    src_choices = [*(srcs or _choices(request.source, Direction.SRC))]
    sink_choices = [*(sinks or _choices(request.sink, Direction.SINK))]
    for element, direction, choices in (
        (request.source, Direction.SRC, src_choices),
        (request.sink, Direction.SINK, sink_choices),
    ):
        if not choices:
            raise _nothing_free(element, direction, request.place)
    if not strict and len(src_choices) == len(sink_choices) == 1 and not awaits_pads(request.source):
        return src_choices[0], sink_choices[0]
    # Existing pads come before pads to be requested, on the source's side first.
    pairs = sorted(
        ((src, sink) for src in src_choices for sink in sink_choices),
        key=lambda pair: (not isinstance(pair[0], Pad), not isinstance(pair[1], Pad)),
    )
    for fits in (_intersect,) if strict else (_intersect, are_convertible):
        for src, sink in pairs:
            if fits(_caps(src), _caps(sink)):
                return src, sink
    raise _caps_conflict(request, src_choices[0], sink_choices[0])


def awaits_pads(element: Element) -> bool:
    """Whether the stream may add src pads later."""
    return any(
        template.presence is Presence.SOMETIMES and template.direction is Direction.SRC
        for template in element.pad_templates.values()
    )


def _choices(element: Element, direction: Direction) -> Iterator[Pad | PadTemplate]:
    """Free pads, then templates of request pads."""
    for pad in list(element.pads.values()):
        if pad.template.direction is direction and pad.peer is None:
            yield pad
    for template in element.pad_templates.values():
        if template.direction is direction and template.presence is Presence.REQUEST:
            yield template


def _caps(choice: Pad | PadTemplate) -> Caps:
    if not isinstance(choice, Pad):
        return choice.caps
    try:
        return choice.query_caps()
    except RecursionError:  # a loop of links
        return choice.template.caps


def _pad(element: Element, choice: Pad | PadTemplate, made: list[Pad]) -> Pad:
    """A chosen pad; a requested one is appended to `made`."""
    if isinstance(choice, Pad):
        return choice
    made.append(element.request_pad(choice))
    return made[-1]


def _intersect(offered: Caps, accepted: Caps) -> bool:
    return not (offered & accepted).is_empty


def are_convertible(offered: Caps, accepted: Caps) -> bool:
    """Whether caps conflict in the format of raw video only, so that negotiation inserts a converter."""
    return _intersect(offered.without_fields("format") & RAW_VIDEO, accepted.without_fields("format"))


def _named(element: Element, direction: Direction, name: str, place: Place, made: list[Pad]) -> Pad:
    """The pad of a name; a new one is appended to `made`."""
    pad = element.pads.get(name)
    if pad is None:
        for template in element.pad_templates.values():
            fits = template.matches(name) or template.name == name
            if template.direction is direction and template.presence is not Presence.ALWAYS and fits:
                if template.presence is Presence.SOMETIMES and "%u" in template.name:
                    continue
                made.append(element.request_pad(template, name))
                return made[-1]
        known = dict.fromkeys(
            [*element.pads, *(template.name for template in element.pad_templates.values())]
        )
        hint = did_you_mean(name, known) or f"it has {', '.join(known) or 'none'}"
        raise DescriptionError("link", f"{element.name} has no pad {name!r}", place, hint)
    if pad.template.direction is not direction:
        raise DescriptionError(
            "link", f"{pad.path} is a {pad.template.direction} pad, here a {direction} pad is needed", place
        )
    if pad.peer is not None:
        raise DescriptionError("link", f"{pad.path} is linked to {pad.peer.path} already", place)
    return pad


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


def _caps_conflict(request: LinkRequest, src: Pad | PadTemplate, sink: Pad | PadTemplate) -> DescriptionError:
    left, right = f"{request.source.name}.{src.name}", f"{request.sink.name}.{sink.name}"
    text = _caps(src).disagreement(_caps(sink), left, right)
    return DescriptionError("link", f"could not link {left} to {right}: they {text}", request.place)


@dataclass(slots=True)
class DelayedLink:
    """A link that is tried whenever its source adds a pad.

    Attributes:
        request: the two elements and the named pads.
        make: makes a link, with its caps filter.
        every_pad: whether it links every new pad.
        has_succeeded: whether it has linked a pad.
    """

    request: LinkRequest
    make: Callable[[LinkRequest], list[tuple[Pad, Pad]]]
    every_pad: bool = False
    has_succeeded: bool = False

    @property
    def source(self) -> Element:
        """The element that adds the pad."""
        return self.request.source

    @property
    def description(self) -> str:
        """The link as text."""
        request = self.request
        src = f"{request.source.name}.{request.src_name}"
        return f"{src} ! {request.sink.name}{'.' if request.sink_name else ''}{request.sink_name}"

    def try_link(self, element: Element, pad: Pad) -> list[tuple[Pad, Pad]]:
        """Links a new pad if it matches; returns the links made."""
        if element is not self.request.source or pad.template.direction is not Direction.SRC:
            return []
        if pad.peer is not None or (self.has_succeeded and not self.every_pad):
            return []
        if self.request.src_name not in ("", pad.name, pad.template.name):
            return []
        try:
            made = self.make(self.request._replace(src_name=pad.name))
        except DescriptionError:
            return []
        self.has_succeeded = True
        return made
