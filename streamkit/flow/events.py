"""Events: what travels in order with the frames, and what a pad tells besides data."""

from __future__ import annotations

from dataclasses import dataclass

from streamkit.flow.caps import Caps
from streamkit.flow.segment import Segment


@dataclass(frozen=True, slots=True)
class CapsEvent:
    """The frames that follow have these caps."""

    caps: Caps


@dataclass(frozen=True, slots=True)
class SegmentEvent:
    """The timestamps that follow lie on the running time so."""

    segment: Segment


@dataclass(frozen=True, slots=True)
class GapEvent:
    """No frame comes for a while; it stands for one where data is waited for.

    Attributes:
        pts: start of the gap, ns; None if unknown.
        duration: ns; None if unknown.
    """

    pts: int | None
    duration: int | None = None


@dataclass(frozen=True, slots=True)
class DiscontinuityEvent:
    """The stream was interrupted: the frames that follow belong to a new epoch."""

    epoch: int
    reason: str = ""


@dataclass(frozen=True, slots=True)
class EosEvent:
    """No frame follows."""


@dataclass(frozen=True, slots=True)
class FlushStart:
    """Drop what is held and refuse frames until `FlushStop`; overtakes frames, in the sender's thread."""


@dataclass(frozen=True, slots=True)
class FlushStop:
    """Frames are welcome again; nothing of what came before the flush remains."""


Event = CapsEvent | SegmentEvent | GapEvent | DiscontinuityEvent | EosEvent | FlushStart | FlushStop
EOS = EosEvent()
FLUSH_START = FlushStart()
FLUSH_STOP = FlushStop()
