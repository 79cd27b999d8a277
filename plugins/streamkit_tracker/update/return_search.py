"""Finds a target drawn by hand again after it was lost: by a detector, over several frames."""

from __future__ import annotations

import math

from streamkit_tracker.appearance.correlation_filter import MIN_SHARPNESS, FilterHistory
from streamkit_tracker.appearance.frame_detector import FrameDetector, Survey
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.window_geometry import FloatArray

LOOK_EVERY = 4  # frames
AGREEING = 4  # looks in a row
TRUSTED = 5  # first looks, in which the detector has learnt too little to contradict
USUAL_RATE = 0.1
DOUBTING = 2  # looks in a row that find the target elsewhere
DISTINCT = 1.3  # times the best score elsewhere
MAX_STEP = 1.0  # sides that the target may move between two looks


class ReturnSearch:
    """Looks at the frame now and then, with a detector that has learnt the sure frames of a target.

    The detector learns a frame only if it finds the target there by itself, so that what the tracker follows
    by mistake does not become the target's look. Another place is believed when several looks in a row agree
    on it: each time its score is nearer to the target's usual one than to that of the background and clearly
    above that of any other place, and on average the oldest copy of the filter, which knows finer detail,
    prefers it to what is followed. Before that, two looks that find the target elsewhere put it in doubt.

    Args:
        sampler: has been shown the first frame.
        window: float64[5], the first window.
    """

    def __init__(self, sampler: WindowSampler, window: FloatArray) -> None:
        self._detector = FrameDetector(sampler, window)
        self._known = window.copy()
        self._frames = self._learnt = self._agreeing = self._misses = 0
        self._usual_score = self._usual_elsewhere = 0.0
        self._agreed_place = window[:2]
        self._preference = 0.0

    def look(
        self, sampler: WindowSampler, window: FloatArray, filters: FilterHistory, *, is_seen: bool
    ) -> FloatArray | None:
        """Looks at the frame, if it is the turn of this one.

        Args:
            sampler: has been shown the frame.
            window: float64[5], where the target is followed.
            filters: of the target; `is_sure` is read, `is_doubted` is set.
            is_seen: whether the target was recognised.

        Returns:
            The window float64[5] on which several looks agree, or None.
        """
        self._frames += 1
        if is_seen and filters.is_sure:
            self._known = window.copy()
        if self._frames % LOOK_EVERY:
            return None
        found = self._known.copy()
        found[:2] = window[:2]
        survey = self._detector.survey(sampler, found)
        is_found = self._is_found(survey, window[:2])
        self._misses = 0 if is_found else self._misses + 1
        filters.is_doubted = self._misses >= DOUBTING
        if is_seen and filters.is_sure and is_found:
            self._remember(survey, window[:2])
            self._detector.learn(survey, sampler, window)
            self._agreeing = 0
            return None
        found[:2] = survey.best_place()
        if not self._is_distinct(survey, found[:2]):
            self._agreeing = 0
            return None
        followed = filters.oldest_sharpness(sampler, window) if is_seen else MIN_SHARPNESS
        self._count_agreement(
            found[:2], survey.side, math.log(filters.oldest_sharpness(sampler, found) / followed)
        )
        if self._agreeing < AGREEING:
            return None
        self._agreeing = 0
        return found if self._preference > 0 else None

    def _count_agreement(self, place: FloatArray, side: float, preference: float) -> None:
        """Counts a look that found a place, x y float64[2], and how far the filter prefers it."""
        is_same = self._agreeing > 0 and math.dist(place, self._agreed_place) <= MAX_STEP * side
        self._agreeing = self._agreeing + 1 if is_same else 1
        self._preference = self._preference + preference if is_same else preference
        self._agreed_place = place

    def _is_found(self, survey: Survey, place: FloatArray) -> bool:
        """Whether the detector finds the target at x y, float64[2], by itself."""
        return self._learnt < TRUSTED or survey.score_at(place) > survey.score_elsewhere(place)

    def _remember(self, survey: Survey, place: FloatArray) -> None:
        """Takes the scores of a target at x y, float64[2], for usual ones."""
        here, elsewhere = survey.score_at(place), survey.score_elsewhere(place)
        self._learnt += 1
        rate = max(USUAL_RATE, 1 / self._learnt)
        self._usual_score += rate * (here - self._usual_score)
        self._usual_elsewhere += rate * (max(elsewhere, 0.0) - self._usual_elsewhere)

    def _is_distinct(self, survey: Survey, place: FloatArray) -> bool:
        """Whether the score at x y, float64[2], is like the target's, and above that of all other places."""
        least = (self._usual_score + self._usual_elsewhere) / 2
        return survey.score_at(place) > max(least, DISTINCT * survey.score_elsewhere(place), 0.0)
