"""Whether a target is there: judged by what has been usual for this one target."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import median

REMEMBERED = 15
FIRST_PEAK = 0.6
PEAK_SEEN = 0.35
PEAK_FOUND_AGAIN = 0.6
PEAK_LEARNT = 0.5
LEAST_SHARPNESS = 5.0
SHARP = 9.0  # a peak that stands out like this is the target, however its look has changed
SHARP_SOFT = 5.5
RIGID = 2.0
USUAL_DISTANCE = 0.05


@dataclass(frozen=True)
class Verdict:
    """What one frame says about a target.

    Attributes:
        seen: the target is there.
        learnt: and looks so much like itself that its template may follow it.
    """

    seen: bool
    learnt: bool


class Evidence:
    """The distances and responses of the frames in which a target was seen, and gates relative to them.

    A rigid car keeps a distance of 0.02 to its template, a running person one of 0.7. One absolute threshold
    loses the person at once or never loses the car.

    Args:
        lost_threshold: similarity, exp(-distance), that is enough by itself to be seen.
        update_threshold: the same to be learnt.
    """

    def __init__(self, lost_threshold: float, update_threshold: float) -> None:
        self._seen_distance = -math.log(max(lost_threshold, 1e-9))
        self._learnt_distance = -math.log(max(update_threshold, 1e-9))
        self._distances: deque[float] = deque([0.0], maxlen=REMEMBERED)
        self._peaks: deque[float] = deque([FIRST_PEAK], maxlen=REMEMBERED)

    @property
    def tolerance(self) -> float:
        """How many times the variance of the residual is larger than that of a rigid target, 1 or more."""
        return max(1.0, median(self._distances) / USUAL_DISTANCE)

    @property
    def usual_peak(self) -> float:
        """Median response of the frames in which the target was seen."""
        return median(self._peaks)

    def responds(self, peak: float, sharpness: float, *, unseen: bool) -> bool:
        """Whether a filter response is as high as this target's usually are.

        Args:
            peak: height of the response.
            sharpness: its peak to sidelobe ratio.
            unseen: the target was not seen in the last frame; then more is asked.
        """
        share = PEAK_FOUND_AGAIN if unseen else PEAK_SEEN
        alone = SHARP_SOFT if self.tolerance > RIGID else SHARP
        if sharpness >= (SHARP if unseen else alone):
            return True
        return peak >= share * self.usual_peak and sharpness >= LEAST_SHARPNESS

    def judge(
        self, distance: float, response: tuple[float, float] | None, *, informative: bool, unseen: bool
    ) -> Verdict:
        """Weighs one frame, and remembers it when the target was seen.

        Args:
            distance: of the best window to the template.
            response: height and sharpness of a filter response that `responds` took, or None.
            informative: whether the image told one place from another.
            unseen: the target was not seen in the last frame.
        """
        gate = self._learnt_distance if unseen else self._seen_distance
        seen = (informative and distance <= gate) or response is not None
        clear = False
        if response is not None and self.tolerance > RIGID:
            peak, sharpness = response
            clear = peak >= PEAK_LEARNT * self.usual_peak or sharpness >= SHARP_SOFT
        learnt = seen and (distance <= self._learnt_distance or clear)
        if seen:
            self._distances.append(distance)
            if response is not None:
                self._peaks.append(response[0])
        return Verdict(seen, learnt)
