"""Dense matching of frames with the current keyframe, with a prediction of how far the camera moves."""

import math
from functools import lru_cache
from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    IDENTITY,
    FloatArray,
    GreyArray,
    inverse,
    project,
    resized,
)
from streamkit_stitcher.plane.keyframe_content import KeyframeContent
from streamkit_stitcher.plane.keyframes import MIN_CORNER_STD, Keyframe, KeyframeMatch
from streamkit_stitcher.plane.rest import RestBelief, RestEvidence, probability_beyond
from streamkit_stitcher.registration.block_sums import SingleArray
from streamkit_stitcher.registration.dense_alignment import (
    ELSEWHERE,
    DenseAlignment,
    align_densely,
)
from streamkit_stitcher.registration.dense_level import STEP_RATIOS, DenseLevel, levels_of, textures_of
from streamkit_stitcher.registration.motion_models import MotionFit, MotionModel
from streamkit_stitcher.registration.tilt import TiltRatio

_CACHED: Final = 3
_FIRST_DEVIATION: Final = 2.0
# Not less, however steady the camera is: errors of successive frames are alike, and do not average out.
_MIN_DEVIATION: Final = 0.3
_MAX_DEVIATION: Final = 8.0
_GAIN: Final = 0.1
_OUTLIER: Final = 3.0
# Part by which a camera that has rested at the keyframe is preferred there beyond what the frame shows.
_PERSISTENCE: Final = 0.5
# Difference of textures that are alike but for noise.
_NOISE_RMSE: Final = 0.17
# Weight of the deviations by which the fit excludes an error, beside those by which parts of the frame do:
# movers and leaves bend the fit, noise and compression do not.
_FIT_WEIGHT: Final = 1 / 3
# Error of the worst corner that each frame is tested for, px.
_DOUBTED: Final = 2.0
_SAME: Final = 1e-6
# Blocks stand for patches of the keyframe, with numbers beyond those of patches and features.
_FIRST_BLOCK: Final = 1 << 19


class DenseMatcher:
    """Registers frames to a keyframe by `align_densely`, and learns how steady the camera is.

    A steady camera makes large motions improbable: a mover must then show more of the frame than its own
    area to be taken for the world.
    """

    def __init__(self) -> None:
        self._levels = lru_cache(maxsize=_CACHED)(_levels)
        self._small: GreyArray | None = None
        self._textures: tuple[SingleArray, ...] = ()
        self._deviation = _FIRST_DEVIATION
        self._covariance, self._std = np.zeros((8, 8)), 0.0
        self._rest = RestBelief()
        self._resting = RestEvidence()
        self._tilt = TiltRatio()

    def match(
        self,
        keyframe: Keyframe,
        small: GreyArray,
        before: FloatArray,
        before_std: float,
        expected: FloatArray,
    ) -> KeyframeMatch:
        """The likeliest match with a keyframe; its `share` is small where next to nothing agrees.

        Where that explains the frame, the camera is preferred to be where it was at the keyframe, the more so
        the more often it was.

        Args:
            keyframe: the keyframe.
            small: uint8[h, w], the frame at working size.
            before: the previous frame to the keyframe.
            before_std: its predicted error, px.
            expected: the predicted homography to the keyframe.
        """
        factor = keyframe.factor
        predictions = [resized(inverse(matrix), 1 / factor) for matrix in (IDENTITY, before, expected)]
        prior = self._prior(before_std / factor)
        levels = self._levels(keyframe.content())
        found = align_densely(
            levels,
            self._textures_of(small),
            predictions,
            prior,
            self._rest.share,
            shakes=self._rest.shakes,
            tilt=self._tilt,
            doubted=_DOUBTED / factor,
        )
        self._learn(found)
        if not found.at_rest:
            self._tilt.learn(levels[-1], found.key_to_frame, found.tilt, found.tilt_variances)
        was_at_rest = self._resting.keyframe == keyframe.index and np.allclose(before, IDENTITY, atol=_SAME)
        if not (found.at_rest and was_at_rest):
            self._resting = RestEvidence(keyframe.index)
        return self._match_of(found, keyframe, before_std, self._resting.add(found.evidence))

    def match_from(
        self, keyframe: Keyframe, small: GreyArray, proposed: FloatArray, before_std: float
    ) -> KeyframeMatch:
        """The likeliest match near a homography that others propose, which teaches nothing about the camera.

        Args:
            keyframe: the keyframe.
            small: uint8[h, w], the frame at working size.
            proposed: the frame to the keyframe.
            before_std: predicted error of the previous frame, px.
        """
        factor, levels = keyframe.factor, self._levels(keyframe.content())
        prediction, prior = resized(inverse(proposed), 1 / factor), self._prior(before_std / factor)
        found = align_densely(
            levels,
            self._textures_of(small),
            [prediction],
            prior,
            tilt=self._tilt,
            doubted=_DOUBTED / factor,
        )
        return self._match_of(found, keyframe, before_std, RestEvidence().add(found.evidence))

    def _textures_of(self, small: GreyArray) -> tuple[SingleArray, ...]:
        """The textures of a frame, computed once however often it is matched."""
        if self._small is not small:
            self._small, self._textures = small, textures_of(small)
        return self._textures

    def _match_of(
        self, found: DenseAlignment, keyframe: Keyframe, before_std: float, wrong: float
    ) -> KeyframeMatch:
        """The match with a keyframe; `wrong` is the probability that another motion is right."""
        factor, levels = keyframe.factor, self._levels(keyframe.content())
        std = self._error_of(found, factor, before_std, wrong)
        to_key = IDENTITY if found.at_rest else resized(inverse(found.key_to_frame), factor)
        key_points = levels[-1].centres[found.blocks] * factor + (factor - 1) / 2
        inliers = np.arange(found.compared) < len(key_points)
        return KeyframeMatch(
            MotionFit(to_key, MotionModel.HOMOGRAPHY, inliers, found.rmse),
            project(inverse(to_key), key_points),
            key_points,
            found.blocks + _FIRST_BLOCK,
            std,
            std,
            share=found.agreement,
        )

    def _error_of(self, found: DenseAlignment, factor: int, before_std: float, wrong: float) -> float:
        """The predicted error at the worst corner, px: of the fit, and of motions that cannot be excluded."""
        std = found.corner_std * factor
        if found.at_rest:
            std = math.hypot(std, found.away * factor) * (1 - _PERSISTENCE * self._rest.share)
        else:
            doubt = probability_beyond(found.bent_evidence + _FIT_WEIGHT * _DOUBTED / std)
            difference = (found.rmse / _NOISE_RMSE) ** 2
            # Where the parts speak against the motion, textures differ by more than noise: movers bend it.
            grown = std * max(1.0, difference) if found.bent_evidence < 0 else std
            std = min(1.0, difference) * math.hypot(grown, _DOUBTED * math.sqrt(doubt))
        # Four times what is tested, however large the frame is.
        reach = math.hypot(ELSEWHERE, before_std)
        return math.hypot(MIN_CORNER_STD * factor, std, reach * math.sqrt(wrong))

    def _prior(self, before_std: float) -> FloatArray:
        """Covariance of the step from a prediction, float64[8, 8], px.

        A doubtful previous frame, `before_std` px at working size, makes more room, so that the truth is
        found again.
        """
        doubt = max(0.0, before_std**2 - self._std**2 - MIN_CORNER_STD**2)
        return self._covariance + np.diag((self._deviation**2 + doubt) * STEP_RATIOS**2)

    def _learn(self, found: DenseAlignment) -> None:
        self._rest.learn(found)
        # Expectation maximisation: without evidence the posterior is the prior, and nothing is learned.
        squares = (found.step**2 + np.diag(found.covariance) - np.diag(self._covariance)) / STEP_RATIOS**2
        size = float(np.clip(squares[:4].mean(), 0.0, (_OUTLIER * self._deviation) ** 2))
        deviation = np.sqrt((1 - _GAIN) * self._deviation**2 + _GAIN * size)
        self._deviation = float(np.clip(deviation, _MIN_DEVIATION, _MAX_DEVIATION))
        self._covariance, self._std = found.covariance, found.corner_std


def _levels(content: KeyframeContent) -> tuple[DenseLevel, ...]:
    return tuple(DenseLevel(image) for image in levels_of(content.small))
