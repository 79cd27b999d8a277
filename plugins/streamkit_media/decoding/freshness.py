"""Drops live frames that have become too old on their way through the decoder."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

WINDOW = 32
FIRST_DELAY_NS = 50_000_000
LEAST_GAIN_NS = 5_000_000


@dataclass(frozen=True, slots=True)
class Freshness:
    """Metadata of a live packet: its frame is shown soon or not at all.

    Attributes:
        slack_ns: by how much the frame's age may exceed the inherent delay.
    """

    slack_ns: int


class InherentDelay:
    """Estimates the delay that every frame has, and finds frames that have waited in addition.

    The minimum age of the last 32 frames is the inherent delay: reordering of the codec, and the time that
    decoding takes. Older frames have waited; they are dropped only while that makes the next one younger.
    """

    def __init__(self) -> None:
        self._ages = deque([FIRST_DELAY_NS] * WINDOW, WINDOW)
        self._dropped_age_ns: int | None = None

    def add(self, age_ns: int) -> None:
        """Adds the age of a frame that is not shown for another reason."""
        self._ages.append(age_ns)

    def has_waited(self, age_ns: int, slack_ns: int) -> bool:
        """Adds the next frame's age since arrival; whether to drop it, older than the delay and the slack."""
        self._ages.append(age_ns)
        if self._dropped_age_ns is None:
            has_waited = age_ns - min(self._ages) > slack_ns
        else:
            has_waited = self._dropped_age_ns - age_ns > LEAST_GAIN_NS
        self._dropped_age_ns = age_ns if has_waited else None
        return has_waited
