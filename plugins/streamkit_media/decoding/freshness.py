"""How old a live picture may be when it leaves the decoder."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

WINDOW = 32
FIRST_DELAY_NS = 50_000_000
LEAST_GAIN_NS = 5_000_000


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
    or a machine on which decoding takes long, has it for all of them. What is older has waited; newer ones
    stand behind it, and those that are left out make way for the newest, as long as each is younger than the
    one before. Where none is, leaving out makes none younger.
    """

    def __init__(self) -> None:
        self._ages = deque([FIRST_DELAY_NS] * WINDOW, WINDOW)
        self._left_out_ns: int | None = None

    def note(self, age_ns: int) -> None:
        """Takes the age of a picture of which it is known already that it is not shown."""
        self._ages.append(age_ns)

    def has_waited(self, age_ns: int, slack_ns: int) -> bool:
        """Takes the age of the next picture and says whether it is to be left out.

        Args:
            age_ns: since its packet came.
            slack_ns: how much more than the delay that cannot be helped is still young.
        """
        self._ages.append(age_ns)
        if self._left_out_ns is None:
            has_waited = age_ns - min(self._ages) > slack_ns
        else:
            has_waited = self._left_out_ns - age_ns > LEAST_GAIN_NS
        self._left_out_ns = age_ns if has_waited else None
        return has_waited
