"""Pads connect elements: a template is declared on the class, a pad belongs to an element."""

from __future__ import annotations

import enum
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, cast

from streamkit.errors import NotNegotiated, StateError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import (
    OPEN_SEGMENT,
    CapsEvent,
    EosEvent,
    Event,
    Flushing,
    FlushStart,
    FlushStop,
    NotLinked,
    Segment,
    SegmentEvent,
)

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.flow.frame import Frame


class Direction(enum.StrEnum):
    """Direction of a pad, seen from its element."""

    SINK = "sink"
    SRC = "src"


class Presence(enum.StrEnum):
    """When a pad exists: always, when a link requests it, or when the stream contains it."""

    ALWAYS = "always"
    REQUEST = "request"
    SOMETIMES = "sometimes"


@dataclass(frozen=True)
class PadTemplate:
    """A kind of pad that an element class has; `%u` in the name stands for a number ("src_%u")."""

    name: str
    direction: Direction
    caps: Caps = field(default=ANY)
    presence: Presence = Presence.ALWAYS

    def matches(self, pad_name: str) -> bool:
        """Whether the template can make a pad of this name."""
        head, mark, tail = self.name.partition("%u")
        if not mark:
            return pad_name == self.name
        number = pad_name[len(head) : len(pad_name) - len(tail)]
        return pad_name.startswith(head) and pad_name.endswith(tail) and number.isdecimal()


class Pad:
    """A pad of one element.

    Attributes:
        name: unique in its element.
        peer: the pad it is linked to, or None.
        caps: current caps, or None before negotiation.
        segment: maps timestamps to running time.
        push: sends a frame to the peer (src pads, while the graph plays).
        is_eos: whether EOS has passed: it was sent (src pads) or taken (sink pads). A flush leaves it so.
        awaits_first_frame: whether it joins a running stream with its next frame; until then only EOS and
            flushes pass.
        known_caps: cached result of `query_caps`, or None.
    """

    def __init__(self, element: Element, template: PadTemplate, name: str) -> None:
        self.element = element
        self.template = template
        self.name = name
        self.peer: Pad | None = None
        self.caps: Caps | None = None
        self.segment: Segment = OPEN_SEGMENT
        self.push: Callable[[Frame], None] = self.not_linked
        self.is_eos = False
        self.awaits_first_frame = False
        self.known_caps: Caps | None = None

    def __repr__(self) -> str:
        return f"<pad {self.path}>"

    @property
    def path(self) -> str:
        """Element and pad name, for example "queue0.src"."""
        return f"{self.element.name}.{self.name}"

    @property
    def is_src(self) -> bool:
        """Whether it is a src pad."""
        return self.template.direction is Direction.SRC

    @property
    def has_upstream_ended(self) -> bool:
        """Whether EOS was sent to this sink pad, and so no frame follows."""
        return self.peer is not None and self.peer.is_eos

    def link(self, sink: Pad) -> None:
        """Links this src pad to a sink pad."""
        self.peer, sink.peer = sink, self

    def unlink(self) -> None:
        """Removes the link, if there is one."""
        if self.peer is not None:
            self.peer.peer = None
            self.peer = None
        self.push = self.not_linked

    def query_caps(self) -> Caps:
        """Caps that the pad can carry, in the order that the other pads of its element prefer."""
        if self.known_caps is not None:
            return self.known_caps
        return self.element.query_caps(self) & self.template.caps

    def peer_caps(self) -> Caps:
        """Caps that the peer can carry; ANY without a peer."""
        return ANY if self.peer is None else self.peer.query_caps()

    def allowed_caps(self, possible: Caps) -> Caps:
        """What this src pad may send of `possible`: what template and peer allow, in the peer's order.

        Raises:
            NotNegotiated: nothing is left.
        """
        offered = self.template.caps & possible
        accepted = self.peer_caps()
        allowed = accepted & offered
        if allowed.is_empty:
            raise self.refusal(offered, accepted)
        return allowed

    def check_accepted(self, caps: Caps) -> None:
        """Checks that downstream accepts caps that the data has decided.

        Raises:
            NotNegotiated: downstream does not.
        """
        accepted = self.peer_caps()
        if (accepted & caps).is_empty:
            raise self.refusal(caps, accepted)

    def announce_caps(self, frame: Frame) -> Frame:
        """Sends the caps of a frame if they are new; returns the frame with the caps object of the pad.

        Raises:
            NotNegotiated: downstream does not accept them.
        """
        if frame.caps is self.caps:
            return frame
        if self.caps is not None and frame.caps == self.caps:
            return frame.replace(caps=self.caps)
        self.check_accepted(frame.caps)
        self.send_event(CapsEvent(frame.caps))
        return frame

    def refusal(self, offered: Caps, accepted: Caps) -> NotNegotiated:
        """The error for a src pad and its peer without common caps: names both and the field in conflict."""
        sink = self.peer.path if self.peer is not None else "nothing"
        return NotNegotiated(
            f"{self.path} -> {sink}: not negotiated, the pads "
            f"{offered.disagreement(accepted, self.path, sink)}"
        )

    def not_linked(self, frame: Frame) -> None:
        """Raises `NotLinked`, because there is no peer."""
        raise NotLinked(self.path)

    def send_event(self, event: Event) -> None:
        """Sends an event downstream, in order with the frames.

        Elements that only forward it are visited in a loop, so that chains may have any length.
        """
        if self.awaits_first_frame and not isinstance(event, EosEvent | FlushStart | FlushStop):
            return
        onward: tuple[Pad, Event] | None = (self, event)
        while onward is not None:
            src, event = onward
            src.store_event(event)
            if src.peer is None:
                return
            src.peer.store_event(event)
            try:
                onward = src.peer.element.pass_event(src.peer, event)
            except Exception as error:
                if isinstance(event, CapsEvent):
                    src.caps = src.peer.caps = None  # the peer is not configured: its next frame fails, too
                elif isinstance(event, EosEvent) and isinstance(error, Flushing):
                    self.is_eos = src.is_eos = False  # it will be sent once more
                raise

    def receive_event(self, event: Event) -> None:
        """Takes an event from upstream."""
        self.store_event(event)
        onward = self.element.pass_event(self, event)
        if onward is not None:
            onward[0].send_event(onward[1])

    def store_event(self, event: Event) -> None:
        """Stores the caps or segment of the frames that follow, or begins or ends a flush."""
        if isinstance(event, CapsEvent):
            self.caps = event.caps
        elif isinstance(event, SegmentEvent):
            self.segment = event.segment
        elif isinstance(event, EosEvent) and self.is_src:  # of a sink pad, the element sets it
            self.is_eos = True
        elif isinstance(event, FlushStart | FlushStop) and not self.is_src:
            self.is_eos = self.is_eos and self.has_upstream_ended
            self.element.flush(begins=isinstance(event, FlushStart))

    def reset(self) -> None:
        """Resets the state of an earlier run."""
        self.caps = None
        self.segment = OPEN_SEGMENT
        self.is_eos = False


class PadOwner:
    """The pads of an element, and the templates that its class declares.

    Attributes:
        pads: by name.
    """

    sink: ClassVar[str | Caps] = ""
    src: ClassVar[str | Caps] = ""
    templates: ClassVar[tuple[PadTemplate, ...]] = ()
    pad_templates: ClassVar[dict[str, PadTemplate]] = {}
    name: str
    lock: threading.RLock

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        always = {side: getattr(cls, side) for side in Direction}
        found = [PadTemplate(str(side), side, Caps(caps)) for side, caps in always.items() if caps]
        cls.pad_templates = {template.name: template for template in (*found, *cls.templates)}

    def __init__(self) -> None:
        super().__init__()
        self.pads: dict[str, Pad] = {
            template.name: Pad(cast("Element", self), template, template.name)
            for template in self.pad_templates.values()
            if template.presence is Presence.ALWAYS
        }
        self._next_numbers: dict[str, int] = {}

    def sink_pads(self) -> Iterator[Pad]:
        """The sink pads."""
        return (pad for pad in tuple(self.pads.values()) if not pad.is_src)

    def src_pads(self) -> Iterator[Pad]:
        """The src pads."""
        return (pad for pad in tuple(self.pads.values()) if pad.is_src)

    @property
    def sink_caps(self) -> Caps:
        """Current caps of the pad `sink`; ANY before negotiation."""
        return self._caps_of("sink")

    @property
    def src_caps(self) -> Caps:
        """Current caps of the pad `src`; ANY before negotiation."""
        return self._caps_of("src")

    def _caps_of(self, pad_name: str) -> Caps:
        pad = self.pads.get(pad_name)
        return ANY if pad is None or pad.caps is None else pad.caps

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Makes a pad from a request or sometimes template, with the given name or the next number."""
        with self.lock:
            number = self._next_numbers.pop(template.name, None)
            if not name or "%u" in name:
                name = self._next_name(template, number)
            if name in self.pads:
                raise StateError(f"{self.name}: a pad {name!r} is there already")
            pad = self.pads[name] = Pad(cast("Element", self), template, name)
        return pad

    def _next_name(self, template: PadTemplate, number: int | None) -> str:
        """The template's name with a number, else with the one after the highest number in use."""
        head, mark, tail = template.name.partition("%u")
        if not mark:
            return template.name
        if number is None:
            taken = [name[len(head) : len(name) - len(tail)] for name in self.pads if template.matches(name)]
            number = max(map(int, taken), default=-1) + 1
        self._next_numbers[template.name] = number + 1
        return f"{head}{number}{tail}"

    def release_pad(self, pad: Pad) -> None:
        """Unlinks and removes a request pad."""
        pad.unlink()
        with self.lock:
            self.pads.pop(pad.name, None)
            self._next_numbers.pop(pad.template.name, None)
