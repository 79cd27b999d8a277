"""How old a live picture may be when it leaves the decoder."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

WINDOW = 32
FIRST_DELAY_NS = 50_000_000


@dataclass(frozen=True, slots=True)
class Freshness:
    """Metadata of a live packet: its picture is to be shown soon or not at all.

    Attributes:
        slack_ns: by how much its age may pass the delay that cannot be helped.
    """

    slack_ns: int


class DelayGauge:
    """Tells pictures that have waited from those that are as young as they can be.

    The delay that cannot be helped is the least age among the last pictures: a codec that reorders pictures,
    or a machine on which decoding takes long, has it for all of them, and there leaving some out would make
    none younger. What is older has waited, and a newer one is close behind it.
    """

    def __init__(self) -> None:
        self._ages = deque([FIRST_DELAY_NS] * WINDOW, WINDOW)

    def has_waited(self, age_ns: int, slack_ns: int) -> bool:
        """Takes the age of the next picture, shown or not.

        Args:
            age_ns: since its packet came.
            slack_ns: how much more than the delay that cannot be helped is still young.
        """
        self._ages.append(age_ns)
        return age_ns - min(self._ages) > slack_ns
