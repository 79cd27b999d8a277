"""Earlier copies of a target's filter, which say whether it still follows the same target."""

from __future__ import annotations

import math
from collections import deque

from streamkit_tracker.appearance.correlation_filter import MIN_SHARPNESS, CorrelationFilter
from streamkit_tracker.appearance.region_features import Region
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.window_geometry import FloatArray

COPY_EVERY = 10  # frames
COPIES = 3
SURE_SHARPNESS = 10.0  # Bolme et al. (CVPR 2010) report 20 to 60 on a target, about 7 off it
CERTAIN_SHARPNESS = 15.0  # on the target whatever the detector says
SHARPNESS_RATE = 0.07  # of the mean: some 14 frames


class FilterCopies:
    """Copies of a target's filter, made every few frames while the target is sure.

    A filter that follows its own errors responds well to whatever it has learnt by them. The oldest copy has
    not learnt them. While it responds sharply to what is followed, the target is sure.

    Args:
        latest: the filter as it was trained on the first frame.

    Attributes:
        sharpness: mean of the last responses of the oldest copy, peak to sidelobe ratios.
    """

    def __init__(self, latest: CorrelationFilter) -> None:
        self.sharpness = math.inf
        self._copies = deque([latest.copy()], maxlen=COPIES)
        self._frames = 0

    @property
    def oldest(self) -> CorrelationFilter:
        """The copy that has learnt the fewest of the latest frames."""
        return self._copies[0]

    def is_sure(self, *, is_contradicted: bool) -> bool:
        """Whether the responses are sharp enough for the target; sharper where the detector contradicts."""
        return self.sharpness >= (CERTAIN_SHARPNESS if is_contradicted else SURE_SHARPNESS)

    def sharpness_near(self, sampler: WindowSampler, window: FloatArray) -> float:
        """Peak to sidelobe ratio of the oldest copy near a window, float64[5]; 1 at least."""
        return max(self.oldest.respond(sampler, window).sharpness, 1.0)

    def compare(self, region: Region | None) -> None:
        """Updates the mean by the region around the window; None where the target was not seen."""
        sharpness = MIN_SHARPNESS if region is None else max(self.oldest.sharpness(region), 1.0)
        known = sharpness if math.isinf(self.sharpness) else self.sharpness
        self.sharpness = known * (sharpness / known) ** SHARPNESS_RATE

    def add(self, latest: CorrelationFilter) -> None:
        """Counts a frame in which the target is sure; every tenth one makes a copy of the filter."""
        self._frames += 1
        if self._frames % COPY_EVERY == 0:
            self._copies.append(latest.copy())
