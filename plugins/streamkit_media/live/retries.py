"""When to connect again, and how long to wait before."""

from __future__ import annotations

import enum
import random

GROWTH = 2.0
MIN_SHARE = 0.5  # jitter: many clients of one server that restarts are not to come back at the same moment


class Reconnect(enum.StrEnum):
    """When to connect again."""

    NEVER = "never"
    ON_ERROR = "on-error"
    ALWAYS = "always"


class Backoff:
    """Capped exponential delays with jitter.

    Args:
        first_s: the first delay before jitter, s.
        cap_s: none is longer, s.
        random_source: of the jitter.

    Source: Brooker, Exponential Backoff and Jitter, "equal jitter".
    """

    def __init__(self, first_s: float, cap_s: float, random_source: random.Random) -> None:
        self._first_s, self._cap_s, self._random = first_s, cap_s, random_source
        self.tries = 0

    def next_delay_s(self) -> float:
        """The delay before the next try, which is counted."""
        # Past 60 doublings every cap is reached; the power itself would overflow at a thousand.
        longest = min(self._cap_s, self._first_s * GROWTH ** min(self.tries, 60))
        self.tries += 1
        return longest * self._random.uniform(MIN_SHARE, 1.0)

    def reset(self) -> None:
        """It worked: the next delay is the first one again."""
        self.tries = 0
