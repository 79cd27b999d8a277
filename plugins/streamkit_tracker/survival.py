"""Survival: how often the targets of a stream are detected before they end."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.window_geometry import IntArray

MEMORY = 50  # targets, of those that reached a number of detections, by which later ones are judged


class Survival:
    """Estimates how many of the targets with some number of detections reach a larger one.

    Of each number up to `until` it counts the targets that have had so many, and those of them that ended
    there; earlier ones fade away. One more that went on is assumed, so that the first target that ends does
    not speak for all.

    Source: Kaplan and Meier, Nonparametric Estimation from Incomplete Observations, 1958.

    Args:
        until: number of detections from which a target counts as lasting.
    """

    def __init__(self, until: int) -> None:
        self._reached, self._ended = np.zeros(until), np.zeros(until)

    def learn(self, detections: IntArray, *, ended: bool) -> None:
        """Counts targets, by their numbers of detections int64[n], that get another one or have ended."""
        until = len(self._reached)
        faded = (1 - 1 / MEMORY) ** np.bincount(detections[detections < until], minlength=until)
        # One after the other each lets those before it fade; this is the sum of the geometric series.
        new = MEMORY * (1 - faded)
        self._reached = self._reached * faded + new
        self._ended = self._ended * faded + new * ended

    def probability(self, detections: int, until: int) -> float:
        """Of reaching `until` detections, for a target that has had so many."""
        reached = slice(detections, until)
        return float(np.prod(1 - self._ended[reached] / (self._reached[reached] + 1)))
