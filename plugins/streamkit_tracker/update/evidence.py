"""Decides whether a target is seen, relative to its own usual distances and responses."""

from __future__ import annotations

import math
from collections import deque
from statistics import median

import msgspec

from streamkit_tracker.appearance.correlation_filter import MIN_SHARPNESS, Response

REMEMBERED = 15
MAX_RIGID_TOLERANCE = 2.0  # a target with a larger one changes its shape
USUAL_DISTANCE = 0.05
MIN_RATE = 0.04  # of the usual response: slow, so that a cover does not become the usual within a second
OUTLIER_WEIGHT = 0.25
FIRST_DEVIATION = 0.7  # of log responses, before a target has shown how much its own vary
# Largest drop of a log response below the usual: in deviations, and by itself, whichever allows more.
CLEAR_DEVIATIONS, CLEAR_DROP = 2.5, 1.0
CREDIBLE_DEVIATIONS, CREDIBLE_DROP = 4.0, 2.1
DOUBTED_SHARE = 0.5  # learnt of a response that is just not clear any more; 0 of the last credible one


class Verdict(msgspec.Struct, frozen=True):
    """What one frame says about a target.

    Attributes:
        seen: the target is there.
        learnt: and matches so well that its template may learn it.
        share: how far a filter is to follow it, 0 to 1: a change of light comes as slowly as an occlusion.
    """

    seen: bool
    learnt: bool
    share: float


class Evidence:
    """The distances and responses of the frames in which a target was seen, and gates relative to them.

    A rigid car keeps a distance of 0.02 to its template, a running person, who changes shape, one of 0.7. One
    absolute threshold loses the person at once or never loses the car. Likewise the response of a correlation
    filter is weak only relative to this target's usual responses and their spread: it is *credible* while it
    may be the target, and *clear* while it is near enough to the usual ones to be learnt.

    Args:
        lost_threshold: similarity, exp(-distance), that is enough by itself to be seen.
        update_threshold: the same to be learnt.

    Attributes:
        usual_distance: median of the distances of the last frames in which the target was seen.
        tolerance: variance of the residual relative to that of a rigid target, 1 or more.
    """

    def __init__(self, lost_threshold: float, update_threshold: float) -> None:
        self._seen_distance = -math.log(max(lost_threshold, 1e-9))
        self._learnt_distance = -math.log(max(update_threshold, 1e-9))
        self._distances: deque[float] = deque([0.0], maxlen=REMEMBERED)
        self.usual_distance = 0.0
        self.tolerance = 1.0
        self._usual_strength = 0.0
        self._deviation = FIRST_DEVIATION
        self._responses = 0

    @property
    def _slack(self) -> float:
        """Factor on the drops allowed: what changes shape responds less even where nothing covers it."""
        return math.sqrt(max(1.0, self.tolerance / MAX_RIGID_TOLERANCE))

    @property
    def _clear_drop(self) -> float:
        return max(CLEAR_DROP * self._slack, CLEAR_DEVIATIONS * self._deviation)

    @property
    def _credible_drop(self) -> float:
        return max(CREDIBLE_DROP * self._slack, CREDIBLE_DEVIATIONS * self._deviation)

    def is_credible(self, response: Response) -> bool:
        """Whether a filter response is no outlier among this target's responses."""
        return response.sharpness >= MIN_SHARPNESS and self.drop(response) <= self._credible_drop

    def is_clear(self, response: Response) -> bool:
        """Whether a response is so near this target's usual ones that its appearance may be learnt."""
        return self.drop(response) <= self._clear_drop

    def judge(self, distance: float, response: Response | None, *, informative: bool) -> Verdict:
        """Weighs one frame, and remembers it when the target was seen.

        Args:
            distance: of the best window to the template.
            response: a filter response that `is_credible` took, or None.
            informative: whether the frame distinguishes positions.
        """
        seen = (informative and distance <= self._seen_distance) or response is not None
        learnt = seen and distance <= self._learnt_distance
        share = float(learnt)
        if response is not None:
            is_clear = self.is_clear(response)
            learnt = is_clear and (learnt or self.tolerance > MAX_RIGID_TOLERANCE)
            credit = (self._credible_drop - self.drop(response)) / (self._credible_drop - self._clear_drop)
            share = 1.0 if is_clear else DOUBTED_SHARE * max(credit, 0.0)
            self._remember(response, weight=1.0 if is_clear else OUTLIER_WEIGHT)
        if seen:
            self._distances.append(distance)
            self.usual_distance = median(self._distances)
            self.tolerance = max(1.0, self.usual_distance / USUAL_DISTANCE)
        return Verdict(seen, learnt, share)

    def drop(self, response: Response) -> float:
        """By how much the logarithm of a response lies below the usual one."""
        return self._usual_strength - response.strength if self._responses else 0.0

    def _remember(self, response: Response, weight: float) -> None:
        if self._responses == 0:
            self._usual_strength = response.strength
        offset = -self.drop(response)
        self._responses += 1
        self._usual_strength += weight * max(MIN_RATE, 1 / self._responses) * offset
        share = max(MIN_RATE, 1 / (self._responses + 5))
        self._deviation += weight * share * (1.25 * abs(offset) - self._deviation)
