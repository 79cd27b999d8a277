"""Reduces particles when frames take too long."""

from __future__ import annotations

MIN_SHARE = 0.125
ROOM = 0.4  # of the budget: twice the particles still fit in
CALM_FRAMES = 10


class Budget:
    """Halves the particles when a frame took longer than it may, and doubles them when there is room again.

    Args:
        seconds: what a frame may take. Only without a limit, when nothing is counted here, runs are alike.

    Attributes:
        share: part of the usual particles, a power of one half, 1 at most.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._calm = 0
        self.share = 1.0

    def spent(self, seconds: float) -> None:
        """Counts the duration of a frame, s."""
        self._calm = self._calm + 1 if seconds < ROOM * self._seconds else 0
        if seconds > self._seconds:
            self.share = max(self.share / 2, MIN_SHARE)
        elif self._calm >= CALM_FRAMES:
            self._calm = 0
            self.share = min(self.share * 2, 1.0)
