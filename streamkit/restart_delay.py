"""RestartDelay: how long to wait before the next try of what has failed."""

from __future__ import annotations

import random

FIRST_DELAY_S, MAX_DELAY_S = 1.0, 60.0
HEALTHY_S = 60.0  # a run that lasted so long makes the next delay the first one again


class RestartDelay:
    """Delays that double up to a limit while tries fail soon.

    Args:
        first_s: the first one, s.
        longest_s: none is longer, s.
        jitter: share by which each is shorter at most, by chance: the clients of a server that restarts are
            not to come back all at once.

    Attributes:
        tries: delays since the last success.

    Source: Brooker, Exponential Backoff and Jitter.
    """

    def __init__(
        self, first_s: float = FIRST_DELAY_S, longest_s: float = MAX_DELAY_S, jitter: float = 0.0
    ) -> None:
        self._first_s, self._longest_s, self._jitter = first_s, longest_s, jitter
        self.tries = 0

    def after(self, lasted_s: float = 0.0) -> float:
        """The delay before the next try, s, after one that lasted so long."""
        if lasted_s >= HEALTHY_S:
            self.reset()
        # Past 60 doublings every limit is reached; the power itself would overflow at a thousand.
        delay_s = min(self._longest_s, self._first_s * 2.0 ** min(self.tries, 60))
        self.tries += 1
        return delay_s * random.uniform(1.0 - self._jitter, 1.0)

    def reset(self) -> None:
        """It worked: the next delay is the first one again."""
        self.tries = 0
