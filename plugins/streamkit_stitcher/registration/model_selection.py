"""Which motion model explains matched points without explaining their noise."""

from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, project
from streamkit_stitcher.registration.motion_models import MotionFit, MotionModel, least_squares, restrict

_MODELS: Final = (MotionModel.HOMOGRAPHY, MotionModel.AFFINE, MotionModel.SIMILARITY)
_PARAMETERS: Final = {MotionModel.HOMOGRAPHY: 8, MotionModel.AFFINE: 6, MotionModel.SIMILARITY: 4}
_FEWEST: Final = 24
_OUTLIER: Final = 2.0
_SMALLEST_VARIANCE: Final = 0.02**2


def gric(residuals: FloatArray, variance: float, parameters: int) -> float:
    """Torr's geometric robust information criterion of a motion between two frames; less is better.

    Args:
        residuals: float64[n, 2], px.
        variance: of one coordinate of the residuals of a model that holds, px squared.
        parameters: of the model.

    Source: Torr, Kanatani: Geometric motion segmentation and model selection, Phil. Trans. R. Soc. A 356,
    1998: r = 4 coordinates a pair, d = 2 dimensions of the model's manifold.
    """
    count = len(residuals)
    squares = np.einsum("ni,ni->n", residuals, residuals) / variance
    capped = np.minimum(squares, 2 * _OUTLIER * 2)
    return float(capped.sum() + 2 * count * np.log(4) + parameters * np.log(4 * count))


@dataclass(frozen=True)
class MotionRule:
    """What a motion may be.

    Attributes:
        model: the motion that is expected.
        strict: whether it may be nothing else; otherwise a homography stands where the pairs speak for it.
    """

    model: MotionModel = MotionModel.HOMOGRAPHY
    strict: bool = True

    def apply(self, fit: MotionFit, source: FloatArray, target: FloatArray) -> MotionFit:
        """A homography's fit turned into one that is allowed.

        Keyframes may happen to be tilted alike, and the frames between them not.

        Args:
            fit: the fitted homography.
            source: float64[n, 2], as it was fitted to.
            target: float64[n, 2].
        """
        simple = restrict(fit, self.model, source, target)
        if simple is fit or self.strict:
            return simple
        first, second = source[fit.inliers], target[fit.inliers]
        residuals = [second - project(own.matrix, first) for own in (fit, simple)]
        variance = _variance(residuals[0])
        whole, plain = (
            gric(own, variance, _PARAMETERS[model])
            for own, model in zip(residuals, (fit.model, simple.model), strict=True)
        )
        return fit if whole < plain else simple


ANY_MOTION: Final = MotionRule()


class ModelSelection:
    """The model that suits the latest pairs of keyframes together.

    One pair decides little; the criteria of the last few are added up, and until there is evidence the
    homography holds.

    Args:
        memory: pairs that count.
    """

    def __init__(self, memory: int = 8) -> None:
        self._scores: deque[FloatArray] = deque(maxlen=memory)

    @property
    def model(self) -> MotionModel:
        """The model of the least criterion so far."""
        if not self._scores:
            return MotionModel.HOMOGRAPHY
        return _MODELS[int(np.argmin(np.sum(self._scores, axis=0)))]

    def add(self, source: FloatArray, target: FloatArray) -> None:
        """Takes the matches of a pair, float64[n, 2] each, free of gross errors; few points say nothing."""
        if len(source) < _FEWEST:
            return
        residuals = []
        for model in _MODELS:
            matrix = least_squares(model, source, target)
            if matrix is None:
                return
            residuals.append(target - project(matrix, source))
        variance = _variance(residuals[0])
        self._scores.append(
            np.array(
                [
                    gric(own, variance, _PARAMETERS[model])
                    for model, own in zip(_MODELS, residuals, strict=True)
                ]
            )
        )


def _variance(residuals: FloatArray) -> float:
    """Of one coordinate of residuals float64[n, 2] that are normal but for some, px squared."""
    # The median length of a 2-D normal error is 1.1774 deviations.
    typical = float(np.median(np.hypot(*residuals.T)))
    return max(_SMALLEST_VARIANCE, (typical / 1.1774) ** 2)
