"""Fewer particles before frames are late."""

from __future__ import annotations

SMALLEST_SHARE = 0.125
ROOM = 0.4  # of the budget: twice the particles still fit in
CALM_FRAMES = 10


class Budget:
    """Halves the particles when a frame took longer than it may, and doubles them when there is room again.

    Attributes:
        share: part of the usual particles, a power of one half, 1 at most.

    Args:
        seconds: what a frame may take; 0 is no limit, which alone gives the same tracks in each run.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._calm = 0
        self.share = 1.0

    def spent(self, seconds: float) -> None:
        """Takes notice of how long a frame took, s."""
        if self._seconds <= 0:
            return
        self._calm = self._calm + 1 if seconds < ROOM * self._seconds else 0
        if seconds > self._seconds:
            self.share = max(self.share / 2, SMALLEST_SHARE)
        elif self._calm >= CALM_FRAMES:
            self.share, self._calm = min(self.share * 2, 1.0), 0
