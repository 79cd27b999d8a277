"""Pads: where elements meet. A template is declared on the class, a pad stands on an element."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import CapsEvent, EosEvent, Event, FlushStart, FlushStop, SegmentEvent
from streamkit.flow.segment import OPEN_SEGMENT, Segment
from streamkit.flow.signals import NotLinked

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.flow.frame import Frame


class Direction(enum.StrEnum):
    """Which way frames go through a pad, seen from its element."""

    SINK = "sink"
    SRC = "src"


class Presence(enum.StrEnum):
    """When a pad exists: always, when a link asks for it, or when the stream turns out to have it."""

    ALWAYS = "always"
    REQUEST = "request"
    SOMETIMES = "sometimes"


@dataclass(frozen=True)
class PadTemplate:
    """A kind of pad that an element class has.

    Attributes:
        name: its name, with `%u` where a number goes ("src_%u").
        direction: sink or src.
        caps: what it can carry.
        presence: always, request or sometimes.
    """

    name: str
    direction: Direction
    caps: Caps = field(default=ANY)
    presence: Presence = Presence.ALWAYS

    def matches(self, pad_name: str) -> bool:
        """Whether a pad of this name can be made from the template."""
        head, mark, tail = self.name.partition("%u")
        if not mark:
            return pad_name == self.name
        number = pad_name[len(head) : len(pad_name) - len(tail)]
        return pad_name.startswith(head) and pad_name.endswith(tail) and number.isdecimal()


class Pad:
    """A pad of one element.

    Attributes:
        element: its element.
        template: what it was made from.
        name: unique in its element.
        peer: the pad it is linked to, or None.
        caps: the caps in force, or None before negotiation.
        segment: how timestamps lie on the running time.
        push: hands a frame to the peer (src pads, while the graph plays).
        is_eos: whether EOS has passed.
        joins: whether it is to join a stream with the next frame; until then only EOS goes through it.
        known_caps: what a query answers for the moment, or None to ask anew.
    """

    __slots__ = (
        "caps", "element", "is_eos", "joins", "known_caps", "name", "peer", "push", "segment", "template",
    )  # fmt: skip

    def __init__(self, element: Element, template: PadTemplate, name: str) -> None:
        self.element = element
        self.template = template
        self.name = name
        self.peer: Pad | None = None
        self.caps: Caps | None = None
        self.segment: Segment = OPEN_SEGMENT
        self.push: Callable[[Frame], None] = self.not_linked
        self.is_eos = False
        self.joins = False
        self.known_caps: Caps | None = None

    def __repr__(self) -> str:
        return f"<pad {self.path}>"

    @property
    def path(self) -> str:
        """Element and pad name, "queue0.src"."""
        return f"{self.element.name}.{self.name}"

    @property
    def is_src(self) -> bool:
        """Whether frames leave through it."""
        return self.template.direction is Direction.SRC

    def link(self, sink: Pad) -> None:
        """Links this src pad to a sink pad."""
        self.peer, sink.peer = sink, self

    def unlink(self) -> None:
        """Undoes the link, if there is one."""
        if self.peer is not None:
            self.peer.peer = None
            self.peer = None
        self.push = self.not_linked

    def query_caps(self) -> Caps:
        """What the pad can carry, given what stands behind its element."""
        if self.known_caps is not None:
            return self.known_caps
        return self.template.caps & self.element.query_caps(self)

    def peer_caps(self) -> Caps:
        """What the peer can carry; ANY where there is none."""
        return ANY if self.peer is None else self.peer.query_caps()

    def not_linked(self, frame: Frame) -> None:
        """Refuses a frame: there is no peer."""
        raise NotLinked(self.path)

    def send_event(self, event: Event) -> None:
        """Sends an event downstream, in order with the frames.

        Elements that only pass it on are walked through in a loop, so that a chain may be of any length.
        """
        if self.joins and not isinstance(event, EosEvent):
            return
        onward: tuple[Pad, Event] | None = (self, event)
        while onward is not None:
            src, event = onward
            src.note(event)
            if src.peer is None:
                return
            src.peer.note(event)
            onward = src.peer.element.pass_event(src.peer, event)

    def receive_event(self, event: Event) -> None:
        """Takes an event from upstream."""
        self.note(event)
        onward = self.element.pass_event(self, event)
        if onward is not None:
            onward[0].send_event(onward[1])

    def note(self, event: Event) -> None:
        """Remembers what an event says of the frames that follow."""
        if isinstance(event, CapsEvent):
            self.caps = event.caps
        elif isinstance(event, SegmentEvent):
            self.segment = event.segment
        elif isinstance(event, FlushStart | FlushStop):
            self.is_eos = False
            if not self.is_src:
                self.element.flush(begins=isinstance(event, FlushStart))

    def reset(self) -> None:
        """Forgets what a run left behind."""
        self.caps = None
        self.segment = OPEN_SEGMENT
        self.is_eos = False


def declared_templates(owner: type[Element]) -> dict[str, PadTemplate]:
    """The templates that an element class declares, by name: `sink` and `src` as caps, then `templates`."""
    found: dict[str, PadTemplate] = {}
    for direction in Direction:
        caps = getattr(owner, str(direction))
        if caps:
            found[str(direction)] = PadTemplate(str(direction), direction, Caps(caps))
    found.update({template.name: template for template in owner.templates})
    return found
