"""Events: what travels in order with the frames, and what a pad tells besides data."""

from __future__ import annotations

from dataclasses import dataclass

from streamkit.flow.caps import Caps


@dataclass(frozen=True, slots=True)
class CapsEvent:
    """The frames that follow have these caps."""

    caps: Caps


@dataclass(frozen=True, slots=True)
class DiscontinuityEvent:
    """The stream was interrupted: the frames that follow belong to a new epoch."""

    epoch: int
    reason: str = ""


@dataclass(frozen=True, slots=True)
class EosEvent:
    """No frame follows."""


Event = CapsEvent | DiscontinuityEvent | EosEvent
EOS = EosEvent()
