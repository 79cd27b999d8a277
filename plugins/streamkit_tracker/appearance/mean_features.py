"""The mean of the feature vectors that came with a target's detections."""

from __future__ import annotations

import math

from streamkit_tracker.window_geometry import FloatArray

DIFFERENCE_RATE = 0.1
KNOWN_FROM = 5  # detections: before, nothing is too different
MIN_LIMIT, USUAL_TIMES = 0.05, 2.0


class MeanFeatures:
    """Mean of the feature vectors of a target's detections, and how far they usually are from it.

    A person who turns differs more from the own mean than one who walks straight on, so what is too
    different is relative to the target.

    Args:
        vector: float[k], of the first detection.
        version: of the space it is in; vectors of different versions do not compare.

    Attributes:
        mean: float[k].
        version: of the space it is in.
        usual_difference: running mean of the differences, one minus the cosine.
    """

    def __init__(self, vector: FloatArray, version: int) -> None:
        self.mean, self.version, self.usual_difference = vector, version, 0.0
        self._detections = 0

    @property
    def limit(self) -> float:
        """Difference above which a detection is of something else."""
        if self._detections < KNOWN_FROM:
            return math.inf
        return MIN_LIMIT + USUAL_TIMES * self.usual_difference

    def learn(self, vector: FloatArray, difference: float, rate: float) -> None:
        """Moves the mean by a share towards the vector float[k] of a detection, which differs from it."""
        self._detections += 1
        share = max(DIFFERENCE_RATE, 1 / self._detections)
        self.usual_difference += share * (difference - self.usual_difference)
        self.mean = (1 - rate) * self.mean + rate * vector
