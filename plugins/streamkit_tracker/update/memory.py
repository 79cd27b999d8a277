"""Filters as they were a while ago: whether a target is still the same one, and where it is if not."""

from __future__ import annotations

import math
from collections import deque

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter, Response
from streamkit_tracker.appearance.region_features import Region
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.update.response import disc_place
from streamkit_tracker.window_geometry import FloatArray

COPY_EVERY = 10  # frames
COPIES = 3
SURE_SHARPNESS = 10.0  # Bolme et al. (CVPR 2010) report 20 to 60 on a target, about 7 off it
SHARPNESS_RATE = 0.07  # of the mean: some 14 frames
REACH_PER_FRAME = 0.1  # sides
BETTER = 1.6  # times as sharp as where the target is followed
AGREEING_FRAMES = 3
SAME_PLACE = 0.5  # sides between the positions of successive frames


class Memory:
    """Copies of a target's filter, which is copied every few frames while the target is sure.

    A filter that follows its own errors responds well to whatever it has learnt by them. The oldest copy has
    not learnt them. While it responds sharply to what is followed, the target is sure; while it does not, it
    is asked at one more place in each frame, in a disc that grows. The target is taken to be there when the
    copy responds sharply there in several frames, and less sharply where the target is followed.

    Args:
        discriminator: as it was trained on the first frame.
    """

    def __init__(self, discriminator: CorrelationFilter) -> None:
        self._copies = deque([discriminator.copy()], maxlen=COPIES)
        self._frames = self._unsure_frames = self._agreeing = 0
        self._candidate: FloatArray | None = None
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
        if not self.is_sure:
            self._unsure_frames += 1
            return
        self._unsure_frames, self._candidate = 0, None
        self._frames += 1
        if self._frames % COPY_EVERY == 0:
            self._copies.append(discriminator.copy())

    def search(self, sampler: WindowSampler, window: FloatArray) -> tuple[Response, CorrelationFilter] | None:
        """Where the target is and the filter that found it, or None while that is not certain.

        Args:
            sampler: has been shown the frame.
            window: float64[5], where the target is followed.
        """
        old, place = self._copies[0], self._candidate
        if place is None:
            place = disc_place(window, self._unsure_frames, REACH_PER_FRAME * self._unsure_frames)
        found = old.respond(sampler, place)
        side = math.sqrt(found.sides[0] * found.sides[1])
        is_elsewhere = math.dist(found.position, window[:2].tolist()) > SAME_PLACE * side
        agrees = self._candidate is None or math.dist(found.position, place[:2].tolist()) < SAME_PLACE * side
        is_better = found.sharpness >= max(SURE_SHARPNESS, BETTER * self.sharpness)
        if not (is_elsewhere and agrees and is_better):
            self._candidate, self._agreeing = None, 0
            return None
        self._candidate, self._agreeing = found.window, self._agreeing + 1
        if self._agreeing < AGREEING_FRAMES:
            return None
        self._candidate, self._agreeing = None, 0
        return found, old.copy()
