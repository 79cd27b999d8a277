"""Agreement on caps between a src pad and what is linked to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from streamkit.errors import NotNegotiated
from streamkit.flow.caps import Caps

if TYPE_CHECKING:
    from streamkit.element.pad import Pad


def refusal(src: Pad, offered: Caps, accepted: Caps) -> NotNegotiated:
    """The error for two pads without common caps: names both, their caps and the field in conflict."""
    sink = src.peer.path if src.peer is not None else "nothing"
    field = offered.conflict(accepted)
    return NotNegotiated(
        f"{src.path} -> {sink}: not negotiated, the pads disagree on {field}: "
        f"{src.path} offers {offered}; {sink} takes {accepted}"
    )


def allowed_caps(src: Pad, possible: Caps) -> Caps:
    """What a src pad may send: `possible`, the pad's template and downstream's wish in common.

    The order of the peer rules: downstream's preference travels up.

    Raises:
        NotNegotiated: nothing is left.
    """
    offered = src.template.caps & possible
    accepted = src.peer_caps()
    allowed = accepted & offered
    if allowed.is_empty:
        raise refusal(src, offered, accepted)
    return allowed


def demand_accepted(src: Pad, caps: Caps) -> None:
    """Checks that downstream takes caps that the data itself has decided.

    Raises:
        NotNegotiated: it does not.
    """
    accepted = src.peer_caps()
    if (accepted & caps).is_empty:
        raise refusal(src, caps, accepted)
