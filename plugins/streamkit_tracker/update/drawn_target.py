"""What follows one target drawn by hand: a filter, earlier copies of it, and a detector."""

from __future__ import annotations

import math

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter, Response
from streamkit_tracker.appearance.filter_copies import FilterCopies
from streamkit_tracker.appearance.region_features import PADDING
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.update.redetection import Redetector
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray

MIN_SHARE = 0.02  # of a region that the filter learns
OLDEST_SHARE = 0.3  # of the response: a few wrong frames must not decide alone


class DrawnTarget:
    """Follows a target that no detections lead, and says whether it is still the same one.

    The filter finds the target near its last position, and learns what it finds. Copies that have not learnt
    the latest frames tell whether that is still the target. A detector searches the whole frame for it.

    Args:
        sampler: has been shown the first frame.
        window: float64[5], the window that was drawn.

    Attributes:
        response: of the filter in this frame, where it is credible, else None.
    """

    def __init__(self, sampler: WindowSampler, window: FloatArray) -> None:
        self._latest = CorrelationFilter(sampler, window)
        self.response: Response | None = None
        self._copies = FilterCopies(self._latest)
        self._redetector = Redetector(sampler, window)

    @property
    def filter(self) -> CorrelationFilter:
        """Responds to the target as the mean of the latest filter and its oldest copy."""
        return self._latest.mixed(self._copies.oldest, OLDEST_SHARE)

    @property
    def is_sure(self) -> bool:
        """Whether what is followed may be claimed to be the target."""
        return self._copies.is_sure(is_contradicted=self._redetector.contradicts)

    def learn(self, sampler: WindowSampler, window: FloatArray | None, share: float) -> None:
        """Lets the filter learn a window, float64[5]; None where the target was not seen.

        `share`, 0 to 1, is how far the window is believed.
        """
        region = None if window is None else self._latest.features.read(sampler, window)
        if region is not None and share > MIN_SHARE:
            self._latest.learn(sampler, region, share)
        self._copies.compare(region)
        if self.is_sure:
            self._copies.add(self._latest)

    def redetect(self, sampler: WindowSampler, window: FloatArray, *, is_seen: bool) -> FloatArray | None:
        """Returns the window float64[5] to follow instead of the present one, or None to go on with that.

        Positions within the region of the filter are left to the filter, which has compared them itself,
        while the target is seen. A target that moves goes on with the oldest copy of its filter.
        """
        found = self._redetector.detect(sampler, window, self._copies, is_seen=is_seen)
        if found is None:
            return None
        apart = math.dist(found[:2], window[:2]) / math.sqrt(found[LENGTH] * found[WIDTH])
        if is_seen and (self.is_sure or apart <= PADDING / 2):
            return None
        self._latest = self._copies.oldest.copy()
        self._copies = FilterCopies(self._latest)
        return found
