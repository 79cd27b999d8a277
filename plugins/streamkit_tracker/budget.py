"""Reduces particles, then searches, when frames take too long."""

from __future__ import annotations

MIN_SHARE = 0.125
MAX_TURN = 4  # frames
ROOM = 0.4  # of the budget: twice the particles still fit in
CALM_FRAMES = 10


class Budget:
    """Halves the particles when a frame took longer than it may, and doubles them when there is room again.

    Args:
        seconds: what a frame may take. Only without a limit, when nothing is counted here, runs are alike.

    Attributes:
        share: part of the usual particles, a power of one half, 1 at most.
        turn: frames after which a target that its detections keep in place is searched again; above 1 where
            the fewest particles still take too long.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._calm = 0
        self.share = 1.0
        self.turn = 1

    def spent(self, seconds: float) -> None:
        """Counts the duration of a frame, s."""
        self._calm = self._calm + 1 if seconds < ROOM * self._seconds else 0
        if seconds > self._seconds:
            if self.share > MIN_SHARE:
                self.share /= 2
            else:
                self.turn = min(self.turn * 2, MAX_TURN)
        elif self._calm >= CALM_FRAMES:
            self._calm = 0
            if self.turn > 1:
                self.turn //= 2
            else:
                self.share = min(self.share * 2, 1.0)
