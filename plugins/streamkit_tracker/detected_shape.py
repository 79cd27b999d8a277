"""Size, place and turn of a target as its detections show them."""

from __future__ import annotations

import math

import numpy as np

from streamkit_tracker.box_shape import window_turn, without_sign
from streamkit_tracker.observation import Sighting
from streamkit_tracker.window_geometry import FloatArray

YOUNG_S = 1.0  # first detections often show a part only: until then size and place follow at once
RATED_S = 0.04  # the step that the rates are for: targets move, turn and come out of hiding by the clock
BOX_RATE, SHRINK_RATE = 0.15, 0.5
OFFSET_RATE = 0.12
YOUNG_OFF, YOUNG_RESIZED = 0.1, 0.1  # relative to the side, and as a log ratio
RESIZED = 0.18  # log ratio of a side beyond which the window starts again
LEAST_FIT, HARDLY_FIT = 0.6, 0.35  # overlap of window and detection below which one of them is wrong
SAME_SIZE = 1.5
PATIENCE, ODD_SIZE_PATIENCE_S = 2, 0.32
MISFITS_BEFORE_RESTART = 3
TRUSTED = 0.3


class DetectedShape:
    """What detections have shown of one target.

    A detection knows where a target is and how large, but trembles; the window, led by the target's
    appearance, is steady but may sit on a part of the target or creep. So the window is left alone while
    both agree, and begins again on the detections where they contradict it for some frames.

    Attributes:
        box: width and height of the upright box, px.
        detected_s: how long the target was detected by itself, s.

    Args:
        box: of the first detection.
    """

    def __init__(self, box: tuple[float, float]) -> None:
        self.box = box
        self.detected_s = 0.0
        self._offset = (0.0, 0.0)
        self._unlike = 0
        self._unfit = 0
        self._step_s = RATED_S

    @property
    def settled(self) -> bool:
        """Whether detections have shown all of the target."""
        return self.detected_s >= YOUNG_S

    def remember(self, sighting: Sighting, step_s: float) -> None:
        """Lets the box follow a detection that shows nothing else."""
        self._step_s = step_s
        if sighting.crowded:
            return
        self.box = (self._side(self.box[0], sighting.box[0]), self._side(self.box[1], sighting.box[1]))
        self.detected_s += step_s

    def _side(self, known: float, seen: float) -> float:
        """One side of the box; while the target is young it is as long as was ever seen, or nearly."""
        young = 1.0 if seen > known else SHRINK_RATE
        return float(known * (seen / known) ** (self._share(BOX_RATE) if self.settled else young))

    def _share(self, rate: float) -> float:
        """What a rate for steps of `RATED_S` comes to in the present step."""
        return float(1.0 - (1.0 - rate) ** (self._step_s / RATED_S))

    def window(self, x: float, y: float, heading: float) -> FloatArray:
        """float64[5]: the box's shape turned into a direction, about a centre."""
        return np.array([x, y, *window_turn(*self.box, heading)])

    def better(
        self, window: FloatArray, sighting: Sighting, heading: float, heading_std: float, trust: float
    ) -> FloatArray | None:
        """Where the window is to begin again, or None where it is right.

        Args:
            window: float64[5], as found by appearance.
            sighting: the target's detection in this frame, which shows nothing else.
            heading: direction of motion, or the window's own, rad.
            heading_std: its standard deviation, rad; infinite where it is not known.
            trust: 0 to 1, how well the detection's size is that of the target.
        """
        if not self.settled:
            side = math.sqrt(float(window[2] * window[3]))
            detected = self.window(*sighting.middle, heading)
            off = math.hypot(*(detected[:2] - window[:2]))
            wrong = off > YOUNG_OFF * side or _resized(window, detected) > YOUNG_RESIZED
            return self._begin_again(detected) if wrong else None
        if self._contradicted(window, sighting):
            self.box = sighting.box
            return self._begin_again(self.window(*sighting.middle, heading))
        x, y, length, width, angle = window.tolist()
        side = math.sqrt(length * width)
        rate = trust * self._share(OFFSET_RATE)
        across = self._offset[0] + rate * (sighting.centroid[0] - x - self._offset[0])
        down = self._offset[1] + rate * (sighting.centroid[1] - y - self._offset[1])
        self._offset = (across, down)
        known_length, known_width, known_angle = window_turn(*self.box, heading)
        wrong = (
            math.hypot(across, down) > max(0.8, 0.06 * side)
            or abs(without_sign(known_angle - angle)) > max(0.25, 2.5 * heading_std)
            or max(abs(math.log(known_length / length)), abs(math.log(known_width / width))) > RESIZED
        )
        if not wrong:
            return None
        return self._begin_again(np.array([x + across, y + down, known_length, known_width, known_angle]))

    def out_of_sight(self, trust: float) -> bool:
        """Counts a frame in which the target was detected but not recognised; True when it is enough."""
        self._unlike += trust > TRUSTED
        return self._unlike >= MISFITS_BEFORE_RESTART

    def recognised(self) -> None:
        """The target looked like itself."""
        self._unlike = 0

    def _contradicted(self, window: FloatArray, sighting: Sighting) -> bool:
        """Whether window and detection have lain apart for so long that the window must be wrong."""
        ratio = sighting.box[0] * sighting.box[1] / (self.box[0] * self.box[1])
        fit = _overlap(window, sighting)
        self._unfit = 0 if fit >= LEAST_FIT else self._unfit + 1
        usual = 1 / SAME_SIZE < ratio < SAME_SIZE
        patience = PATIENCE if usual else max(PATIENCE, round(ODD_SIZE_PATIENCE_S / self._step_s))
        return self._unfit >= patience or (usual and fit < HARDLY_FIT)

    def _begin_again(self, window: FloatArray) -> FloatArray:
        self._unlike, self._unfit, self._offset = 0, 0, (0.0, 0.0)
        return window


def _resized(window: FloatArray, other: FloatArray) -> float:
    """Larger log ratio of the two sides."""
    return max(abs(math.log(float(other[index] / window[index]))) for index in (2, 3))


def _overlap(window: FloatArray, sighting: Sighting) -> float:
    """Intersection over union of a window's upright box and a detection's."""
    numbers: list[float] = window.tolist()
    x, y, length, width, angle = numbers
    cosine, sine = abs(math.cos(angle)), abs(math.sin(angle))
    across, down = length * cosine + width * sine, length * sine + width * cosine
    shared_x = (across + sighting.box[0]) / 2 - abs(x - sighting.middle[0])
    shared_y = (down + sighting.box[1]) / 2 - abs(y - sighting.middle[1])
    shared_x = min(shared_x, across, sighting.box[0])
    shared_y = min(shared_y, down, sighting.box[1])
    common = max(shared_x, 0.0) * max(shared_y, 0.0)
    return common / (across * down + sighting.box[0] * sighting.box[1] - common)


def centroid_std(side: float) -> float:
    """Standard deviation expected of a detection's centroid, px, for a target of a given side, px."""
    return 1.0 + 0.04 * side
