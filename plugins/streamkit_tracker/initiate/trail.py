"""Positions at which a target was detected, in the pixels of the latest frame."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.window_geometry import FloatArray

LONGEST = 16
JITTER, STRAIGHT = 0.5, 0.9


class Trail:
    """The last detected positions of a target on the ground, carried along with the camera.

    Args:
        position: x and y of the first one, px.
    """

    def __init__(self, position: tuple[float, float]) -> None:
        self.positions: FloatArray = np.array([position], np.float64)

    def add(self, position: tuple[float, float]) -> None:
        """Appends x and y, px of the latest frame; the oldest goes when 16 are kept."""
        self.positions = np.vstack([self.positions, position])[-LONGEST:]

    @property
    def span(self) -> FloatArray:
        """float64[2] from the oldest to the latest positions, each averaged over a third, px."""
        part = max(len(self.positions) // 3, 1)
        span = self.positions[-part:].mean(axis=0) - self.positions[:part].mean(axis=0)
        return np.asarray(span, np.float64)

    @property
    def travelled(self) -> float:
        """Length of the span, px."""
        return float(np.hypot(*self.span))

    @property
    def heading(self) -> float:
        """Direction of the span, rad."""
        across, down = self.span
        return float(np.arctan2(down, across))

    @property
    def straightness(self) -> float:
        """Distance travelled over the length of the path: 1 along a line, near 0 for jitter."""
        steps = np.diff(self.positions, axis=0)
        path = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        return float(np.hypot(*(self.positions[-1] - self.positions[0]))) / path if path > 0 else 0.0

    @property
    def steadiness(self) -> float:
        """How far the motion may be expected to go on, 0 to 1: 1 for a path that is long and straight."""
        if len(self.positions) < LONGEST:
            return 0.0
        return min(max((self.straightness - JITTER) / (STRAIGHT - JITTER), 0.0), 1.0)
