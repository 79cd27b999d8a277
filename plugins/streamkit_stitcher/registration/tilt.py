"""How much a camera tilts as it moves: the shear and perspective of its motions, which movers bend most.

A camera that turns to a side shows a perspective in proportion to how far the picture moves. One that flies
along, turns about its axis or zooms moves by similarities. Where movers hide most of a scene, the rest fixes
a similarity well, but shear and perspective badly. How the perspective follows from the shift is therefore
learned for each camera, and how large shear and perspective are beyond that, by the whole motion: together
these give a normal distribution of them.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, MaskArray, corner_shift, inverse
from streamkit_stitcher.registration.dense_level import STEP_RATIOS, DenseLevel

# Motion that is never certain, px.
_JITTER: Final = 1.0
# The ratio, in `STEP_RATIOS`, of a camera that turns about itself and sees 90 degrees, and its weight in
# frames; the least, which noise leaves; and the part of what was learned that each frame forgets.
_FREE: Final = 2.0
_FIRST_WEIGHT: Final = 0.1
_MIN_RATIO: Final = 0.05
_FORGETTING: Final = 0.02
# Variance of what frames show about their tilt, by the predicted one, which allows for movers.
_SCATTER: Final = 0.1
# Square of a frame's tilt, by its expectation, above which the camera tilts unlike before.
_CONTRADICTION: Final = 4.0
# What is known of the perspective by the shift before a frame is seen, the inverse of a variance.
_FIRST_PRECISION: Final = 1 / (_FREE * float(STEP_RATIOS[6])) ** 2


class TiltRatio:
    """Learns how much a camera tilts, as a part of its motion: of shear and of perspective."""

    def __init__(self) -> None:
        # Of the perspective with the shift, and of the shift with itself, weighted by the precision of each.
        self._product = self._square = 0.0
        self._squares, self._weights, self._scatter = np.zeros(2), np.zeros(2), np.zeros(2)
        self._begin(np.ones(2, dtype=np.bool_))

    def _begin(self, which: MaskArray) -> None:
        self._squares[which], self._weights[which], self._scatter[which] = _FREE**2, _FIRST_WEIGHT, 0.0

    def expected(self, level: DenseLevel, motion: FloatArray) -> FloatArray:
        """The shear, which is 0, and the perspective of a motion, keyframe to frame, float64[4], px."""
        slope = self._product / (self._square + _FIRST_PRECISION)
        return np.concatenate([np.zeros(2), slope * _place(level, motion)])

    def variances(self, level: DenseLevel, motion: FloatArray) -> FloatArray:
        """Of the shear and perspective of a motion about the expected ones, float64[4], px squared."""
        return np.asarray(np.repeat(self._squares, 2) * _units(level, motion))

    def learn(self, level: DenseLevel, motion: FloatArray, tilt: FloatArray, variances: FloatArray) -> None:
        """Learns from the shear and perspective that a frame alone shows, and their variances, float64[4].

        A frame counts by the square of its precision, and by that of the frames before.

        Source: scoring for a variance component; Searle, Casella, McCulloch, Variance Components, 1992,
        section 6.3.
        """
        units, away = _units(level, motion), tilt - self.expected(level, motion)
        seen, expected = ((part / units).reshape(2, 2).mean(axis=1) for part in (away**2, variances))
        self._begin(seen > _CONTRADICTION * (self._squares + expected))
        scatter = _SCATTER * expected
        weights = ((self._squares + self._scatter) / (self._squares + scatter)) ** 2
        self._weights = (1 - _FORGETTING) * self._weights + weights
        gains = weights / self._weights
        self._scatter += gains * (scatter - self._scatter)
        self._squares += gains * (np.maximum(seen - scatter, _MIN_RATIO**2) - self._squares)
        place = _place(level, motion)
        weighted = place / (_SCATTER * variances[2:])
        self._product = (1 - _FORGETTING) * self._product + float(weighted @ tilt[2:])
        self._square = (1 - _FORGETTING) * self._square + float(weighted @ place)


def tilt_of(level: DenseLevel, motion: FloatArray) -> FloatArray:
    """Shear and perspective of a motion, float64[4], as the last four parameters of a step, px."""
    return level.step_of(inverse(level.similarity_of(motion)) @ motion)[4:]


def _place(level: DenseLevel, motion: FloatArray) -> FloatArray:
    """Where the middle of the frame lies in the keyframe, from the middle of that, float64[2], px."""
    return level.step_of(inverse(level.similarity_of(motion)))[:2]


def _units(level: DenseLevel, motion: FloatArray) -> FloatArray:
    """Variances at a ratio of 1."""
    length = corner_shift(level.similarity_of(motion), level.shape) ** 2 + _JITTER**2
    return np.asarray(length * STEP_RATIOS[4:] ** 2)


@dataclass(frozen=True, eq=False)
class MotionPrior:
    """What is known of a motion before a frame is compared.

    Attributes:
        start: float64[3, 3], the likeliest motion, keyframe to frame.
        covariance: float64[8, 8], of the step from there, px.
        lasting: float64[8, 8], the inverse of a covariance without what earlier frames say of shear and
            perspective: these err by the same movers.
    """

    start: FloatArray
    covariance: FloatArray
    lasting: FloatArray


def motion_prior(
    level: DenseLevel, prediction: FloatArray, covariance: FloatArray, ratio: TiltRatio
) -> MotionPrior:
    """The product of a prediction and of what is known of the camera's tilt.

    Args:
        level: the finest one of the keyframe.
        prediction: float64[3, 3], keyframe to frame.
        covariance: float64[8, 8], of the step from the prediction, px.
        ratio: of the camera.
    """
    known, lasting = np.zeros((8, 8)), np.zeros((8, 8))
    known[4:, 4:] = lasting[4:, 4:] = np.diag(1 / ratio.variances(level, prediction))
    lasting[:4, :4] = np.linalg.inv(covariance[:4, :4])
    product = np.asarray(np.linalg.inv(np.linalg.inv(covariance) + known), np.float64)
    missing = ratio.expected(level, prediction) - tilt_of(level, prediction)
    step = product[:, 4:] @ known[4:, 4:] @ missing
    return MotionPrior(prediction @ level.matrix_of(step), product, lasting)
