"""Pads connect elements: a template is declared on the class, a pad belongs to an element."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from streamkit.errors import NotNegotiated, StreamkitError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import (
    EOS,
    OPEN_SEGMENT,
    CapsEvent,
    EosEvent,
    Event,
    FlowStop,
    FlushEvent,
    Flushing,
    NotLinked,
    Segment,
    SegmentEvent,
)
from streamkit.flow.video import conversion_remedy

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.flow.frame import Frame

RETRY_S = 0.01


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
        return pad_name == self.name if "%u" not in self.name else self.number(pad_name) is not None

    def number(self, pad_name: str) -> int | None:
        """The number in the name of a pad that the template can make; None for other names."""
        head, _, tail = self.name.partition("%u")
        digits = pad_name[len(head) : len(pad_name) - len(tail)]
        is_of_template = pad_name.startswith(head) and pad_name.endswith(tail) and digits.isdecimal()
        return int(digits) if is_of_template else None


class Pad:
    """A pad of one element.

    Attributes:
        name: unique in its element.
        peer: the pad it is linked to, or None.
        caps: current caps, or None before negotiation.
        segment: maps timestamps to running time.
        push: sends a frame to the peer (src pads, while the graph plays).
        is_eos: whether EOS has passed: it was sent (src pads) or taken (sink pads). A flush leaves it so.
        is_flushing: whether a flush of this sink pad is in progress; its element's ends with the last one.
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
        self.is_eos = self.is_flushing = False
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
        try:
            possible = self.element.query_caps(self)
        except StreamkitError:
            raise
        except Exception as cause:
            raise self.element.failure(cause) from cause
        return possible & self.template.caps

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
        if not accepted.can_intersect(caps):
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
        remedy = conversion_remedy(offered, accepted)
        return NotNegotiated(
            f"{self.path} -> {sink}: not negotiated, the pads "
            f"{offered.disagreement(accepted, self.path, sink)}" + (f"; {remedy}" if remedy else "")
        )

    def not_linked(self, frame: Frame) -> None:
        """Raises `NotLinked`, because there is no peer."""
        raise NotLinked(self.path)

    def send_event(self, event: Event) -> None:
        """Sends an event downstream, in order with the frames.

        Elements that only forward it are visited in a loop, so that chains may have any length.
        """
        if self.awaits_first_frame and not isinstance(event, EosEvent | FlushEvent):
            return
        onward: tuple[Pad, Event] | None = (self, event)
        while onward is not None:
            src, event = onward
            src.apply_event(event)
            if src.peer is None:
                return
            src.peer.apply_event(event)
            try:
                onward = src.peer.element.receive_event(src.peer, event)
            except Exception as error:
                if isinstance(event, CapsEvent):
                    src.caps = src.peer.caps = None  # the peer is not configured: its next frame fails, too
                elif isinstance(event, EosEvent) and isinstance(error, Flushing):
                    self.is_eos = src.is_eos = False  # it will be sent once more
                if isinstance(error, StreamkitError | FlowStop):
                    raise
                raise src.peer.element.failure(error) from error

    def send_eos(self) -> None:
        """Sends EOS downstream; once more if it has met a flush, which drops frames only.

        Raises:
            Flushing: the pipeline stops.
        """
        while not self.is_eos:
            self.element.wait_while_flushing()
            try:
                self.send_event(EOS)
            except Flushing:  # downstream the flush may not be over yet
                self.element.stopping.wait(RETRY_S)

    def receive_event(self, event: Event) -> None:
        """Takes an event from upstream."""
        self.apply_event(event)
        onward = self.element.receive_event(self, event)
        if onward is not None:
            onward[0].send_event(onward[1])

    def apply_event(self, event: Event) -> None:
        """Stores caps, segment or that EOS was sent, for the frames that follow; begins or ends a flush."""
        if isinstance(event, CapsEvent):
            self.caps = event.caps
        elif isinstance(event, SegmentEvent):
            self.segment = event.segment
        elif isinstance(event, EosEvent) and self.is_src:  # of a sink pad, the element sets it
            self.is_eos = True
        elif isinstance(event, FlushEvent) and not self.is_src:
            self.is_flushing = event.begins
            self.is_eos = self.is_eos and self.has_upstream_ended
            if self.is_flushing or not any(pad.is_flushing for pad in self.element.sink_pads()):
                self.element.flush(begins=self.is_flushing)

    def reset(self) -> None:
        """Resets the state of an earlier run."""
        self.caps = None
        self.segment = OPEN_SEGMENT
        self.is_eos = self.is_flushing = False
