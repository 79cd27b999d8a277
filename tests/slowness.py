"""How slow the machine is now, for limits of time that must hold on a busy one, too."""

import time
from typing import Final

WORK: Final = 250_000  # additions
IDLE_S: Final = 0.015


def slowness() -> float:
    """The time of a fixed piece of work, as a multiple of what it takes on an idle machine; 1 at least."""
    began_s = time.monotonic()
    total = 0
    for number in range(WORK):
        total += number
    return max((time.monotonic() - began_s) / IDLE_S, 1.0)


def patience(seconds: float) -> float:
    """The limit, in s, for what takes at most so long on an idle machine."""
    return seconds * slowness()
