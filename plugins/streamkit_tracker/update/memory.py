"""Filters as they were a while ago: whether a target is still the same one."""

from __future__ import annotations

import math
from collections import deque

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter
from streamkit_tracker.appearance.region_features import Region

COPY_EVERY = 10  # frames
COPIES = 3
SURE_SHARPNESS = 10.0  # Bolme et al. (CVPR 2010) report 20 to 60 on a target, about 7 off it
SHARPNESS_RATE = 0.07  # of the mean: some 14 frames


class Memory:
    """Copies of a target's filter, which is copied every few frames while the target is sure.

    A filter that follows its own errors responds well to whatever it has learnt by them. The oldest copy has
    not learnt them. While it responds sharply to what is followed, the target is sure.

    Args:
        discriminator: as it was trained on the first frame.
    """

    def __init__(self, discriminator: CorrelationFilter) -> None:
        self._copies = deque([discriminator.copy()], maxlen=COPIES)
        self._frames = 0
        self.sharpness = math.inf

    @property
    def is_sure(self) -> bool:
        """Whether the last responses were sharp enough to claim that they are the target's."""
        return self.sharpness >= SURE_SHARPNESS

    def compare(self, discriminator: CorrelationFilter, region: Region | None, least: float) -> None:
        """Takes account of a frame.

        Args:
            discriminator: to copy.
            region: around the window, or None where the target was not seen.
            least: sharpness in its place.
        """
        sharpness = least if region is None else max(self._copies[0].sharpness(region), 1.0)
        known = sharpness if math.isinf(self.sharpness) else self.sharpness
        self.sharpness = known * (sharpness / known) ** SHARPNESS_RATE
        if self.is_sure:
            self._frames += 1
            if self._frames % COPY_EVERY == 0:
                self._copies.append(discriminator.copy())
