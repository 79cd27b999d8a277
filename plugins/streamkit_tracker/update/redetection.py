"""Finds a target drawn by hand again after it was lost: by a detector, over several frames."""

from __future__ import annotations

import math

from streamkit_tracker.appearance.correlation_filter import MIN_SHARPNESS
from streamkit_tracker.appearance.filter_copies import FilterCopies
from streamkit_tracker.appearance.frame_detector import FrameDetector
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.window_geometry import FloatArray

DETECT_EVERY = 4  # frames
AGREEING = 4  # detections in a row
TRUSTED = 5  # first detections, in which the detector has learnt too little to contradict
USUAL_RATE = 0.1
CONTRADICTING = 2  # detections in a row that find the target elsewhere
DISTINCT = 1.3  # times the best score elsewhere
MAX_STEP = 1.0  # sides that the target may move between two detections


class Redetector:
    """Searches the whole frame now and then, with a detector that has learnt the sure frames of a target.

    The detector learns a frame only if it finds the target there by itself, so that what the tracker follows
    by mistake does not become the target's appearance. Another position is believed when several detections
    in a row agree on it: each time its score is nearer to the target's usual one than to that of the
    background and clearly above that of any other position, and on average the oldest copy of the filter,
    which knows finer detail, prefers it to what is followed. Before that, two detections elsewhere contradict
    what is followed.

    Args:
        sampler: has been shown the first frame.
        window: float64[5], the first window.
    """

    def __init__(self, sampler: WindowSampler, window: FloatArray) -> None:
        self._detector = FrameDetector(sampler, window)
        self._known = window.copy()
        self._frames = self._learnt = self._agreeing = self._misses = 0
        self._usual_score = self._usual_elsewhere = 0.0
        self._agreed_position = window[:2]
        self._preference = 0.0

    @property
    def contradicts(self) -> bool:
        """Whether the last detections found the target elsewhere than where it is followed."""
        return self._misses >= CONTRADICTING

    def detect(
        self, sampler: WindowSampler, window: FloatArray, copies: FilterCopies, *, is_seen: bool
    ) -> FloatArray | None:
        """Searches the frame, if it is the turn of this one.

        Args:
            sampler: has been shown the frame.
            window: float64[5], where the target is followed.
            copies: of the filter of the target.
            is_seen: whether the target was recognised.

        Returns:
            The window float64[5] on which several detections agree, or None.
        """
        self._frames += 1
        if is_seen and copies.is_sure(is_contradicted=self.contradicts):
            self._known = window.copy()
        if self._frames % DETECT_EVERY:
            return None
        found = self._known.copy()
        found[:2] = window[:2]
        score_map = self._detector.score(sampler, found)
        here, elsewhere = score_map.best_scores(window[:2])
        is_in_place = self._learnt < TRUSTED or here > elsewhere
        self._misses = 0 if is_in_place else self._misses + 1
        if is_seen and is_in_place and copies.is_sure(is_contradicted=False):
            self._remember(here, elsewhere)
            self._detector.learn(score_map, sampler, window)
            self._agreeing = 0
            return None
        found[:2] = score_map.best_position()
        if not self._is_distinct(*score_map.best_scores(found[:2])):
            self._agreeing = 0
            return None
        followed = copies.sharpness_near(sampler, window) if is_seen else MIN_SHARPNESS
        preference = math.log(copies.sharpness_near(sampler, found) / followed)
        self._count_agreement(found[:2], score_map.side, preference)
        if self._agreeing < AGREEING:
            return None
        self._agreeing = 0
        return found if self._preference > 0 else None

    def _count_agreement(self, position: FloatArray, side: float, preference: float) -> None:
        """Counts a detection at x y, float64[2], and how far the oldest copy of the filter prefers it."""
        is_same = self._agreeing > 0 and math.dist(position, self._agreed_position) <= MAX_STEP * side
        self._agreeing = self._agreeing + 1 if is_same else 1
        self._preference = self._preference + preference if is_same else preference
        self._agreed_position = position

    def _remember(self, here: float, elsewhere: float) -> None:
        """Takes the best score at the target, and that of the background, for usual ones."""
        self._learnt += 1
        rate = max(USUAL_RATE, 1 / self._learnt)
        self._usual_score += rate * (here - self._usual_score)
        self._usual_elsewhere += rate * (max(elsewhere, 0.0) - self._usual_elsewhere)

    def _is_distinct(self, here: float, elsewhere: float) -> bool:
        """Whether the best score at a position is like the target's, and above the best elsewhere."""
        least = (self._usual_score + self._usual_elsewhere) / 2
        return here > max(least, DISTINCT * elsewhere, 0.0)
