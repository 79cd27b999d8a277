"""Selection of the motion model that explains matches without fitting their noise."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, project
from streamkit_stitcher.registration.motion_models import MotionFit, MotionModel, least_squares, restrict

_MODELS: Final = (MotionModel.HOMOGRAPHY, MotionModel.AFFINE, MotionModel.SIMILARITY)
_PARAMETERS: Final = {MotionModel.HOMOGRAPHY: 8, MotionModel.AFFINE: 6, MotionModel.SIMILARITY: 4}
_FEWEST: Final = 24
_MIN_VARIANCE: Final = 0.02**2


def gric(residuals: FloatArray, variance: float, parameters: int) -> float:
    """Torr's geometric robust information criterion of a motion between two frames; less is better.

    Args:
        residuals: float64[n, 2], px.
        variance: of one coordinate of the residuals under a correct model, px squared.
        parameters: number of the model.

    Source: Torr, Kanatani: Geometric motion segmentation and model selection, Phil. Trans. R. Soc. A 356,
    1998: r = 4 coordinates a pair, d = 2 dimensions of the model's manifold.
    """
    count = len(residuals)
    squares = np.einsum("ni,ni->n", residuals, residuals) / variance
    # An outlier costs 2 (r - d), whatever its residual.
    capped = np.minimum(squares, 2 * (4 - 2))
    return float(capped.sum() + 2 * count * np.log(4) + parameters * np.log(4 * count))


@dataclass(frozen=True)
class MotionRule:
    """The allowed motion models.

    Attributes:
        model: the expected model.
        strict: whether no other is allowed; otherwise a homography is kept where the matches support it.
    """

    model: MotionModel = MotionModel.HOMOGRAPHY
    strict: bool = True

    def apply(self, fit: MotionFit, source: FloatArray, target: FloatArray) -> MotionFit:
        """Restricts a homography fitted to `source` and `target` to an allowed model.

        Keyframes may all have the same tilt while the frames between them do not.
        """
        if self.model is MotionModel.HOMOGRAPHY:
            return fit
        simple = restrict(fit, self.model, source, target)
        if simple is fit or self.strict:
            return simple
        first, second = source[fit.inliers], target[fit.inliers]
        whole, plain = _criteria([fit, simple], first, second)
        return fit if whole < plain else simple


ANY_MOTION: Final = MotionRule()


class ModelSelection:
    """Selects the model by the summed criteria of the latest pairs of keyframes, at first the homography.

    Args:
        memory: number of pairs.
    """

    def __init__(self, memory: int = 8) -> None:
        self._scores: deque[FloatArray] = deque(maxlen=memory)

    @property
    def model(self) -> MotionModel:
        """The model with the least criterion."""
        if not self._scores:
            return MotionModel.HOMOGRAPHY
        return _MODELS[int(np.argmin(np.sum(self._scores, axis=0)))]

    def add(self, source: FloatArray, target: FloatArray) -> None:
        """Adds the inliers of a pair, float64[n, 2] each; fewer than 24 are ignored."""
        if len(source) < _FEWEST:
            return
        matrices = [least_squares(model, source, target) for model in _MODELS]
        fits = [
            MotionFit(matrix, model, np.ones(len(source), dtype=np.bool_), 0.0)
            for model, matrix in zip(_MODELS, matrices, strict=True)
            if matrix is not None
        ]
        if len(fits) == len(_MODELS):
            self._scores.append(_criteria(fits, source, target))


def _criteria(fits: Sequence[MotionFit], source: FloatArray, target: FloatArray) -> FloatArray:
    """`gric` of each of some motions, by the variance that the first of them leaves."""
    residuals = [target - project(fit.matrix, source) for fit in fits]
    # Robust: the median length of a 2-D Gaussian error is 1.1774 deviations.
    typical = float(np.median(np.hypot(*residuals[0].T)))
    variance = max(_MIN_VARIANCE, (typical / 1.1774) ** 2)
    return np.array(
        [gric(own, variance, _PARAMETERS[fit.model]) for own, fit in zip(residuals, fits, strict=True)]
    )
