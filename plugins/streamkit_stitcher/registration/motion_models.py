"""Robust fits of one image motion to point pairs, from the homography down to the similarity."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import cv2
import numpy as np

from streamkit_stitcher.homographies import IDENTITY, FloatArray, MaskArray, is_plausible, normalised, project

_MAX_ITERATIONS: Final = 500
_CONFIDENCE: Final = 0.995
_TRIM: Final = 2.5
_LEAST_TRIM: Final = 0.1
_REFINEMENTS: Final = 2
_REFINABLE: Final = 12
_KEPT: Final = 0.9


class MotionModel(StrEnum):
    """Motions in falling order of freedom; the later ones stand in where the earlier ones fail."""

    HOMOGRAPHY = "homography"
    AFFINE = "affine"
    SIMILARITY = "similarity"
    TRANSLATION = "translation"
    VELOCITY = "velocity"


@dataclass(frozen=True, eq=False)
class MotionFit:
    """One motion fitted to point pairs.

    Attributes:
        matrix: float64[3, 3], maps source points to target points.
        model: the motion that was fitted.
        inliers: bool[n], pairs within the threshold of the fit.
        rmse: root mean square distance of the inliers, in px of the target.
    """

    matrix: FloatArray
    model: MotionModel
    inliers: MaskArray
    rmse: float

    @property
    def count(self) -> int:
        """Number of inliers."""
        return int(np.count_nonzero(self.inliers))

    @property
    def ratio(self) -> float:
        """Inliers per pair, 0 to 1."""
        return self.count / len(self.inliers) if len(self.inliers) else 0.0


NO_FIT: Final = MotionFit(IDENTITY, MotionModel.HOMOGRAPHY, np.zeros(0, dtype=np.bool_), 0.0)


@dataclass(frozen=True)
class FitLimits:
    """What a fit must reach to be believed.

    Attributes:
        threshold: largest distance of an inlier, px.
        min_inliers: fewest inliers of a homography; simpler motions need proportionally fewer.
        min_ratio: fewest inliers per pair, 0 to 1.
        max_step: largest step of an image corner, as a part of the width.
    """

    threshold: float = 1.0
    min_inliers: int = 20
    min_ratio: float = 0.35
    max_step: float = 0.25


def fit_homography(source: FloatArray, target: FloatArray, threshold: float) -> MotionFit | None:
    """Fits a homography by RANSAC, refined by least squares on the inliers and then on the best of them.

    The last step halves the corner error: slow cars and badly followed points pass RANSAC's threshold, but
    not two and a half times the median distance.

    Args:
        source: float64[n, 2].
        target: float64[n, 2].
        threshold: largest distance of an inlier in px of the target.

    Returns:
        The fit, or None for fewer than 4 pairs or degenerate ones.

    Source: Fischler and Bolles, Random sample consensus, CACM 1981. cv2.USAC_MAGSAC is five times less
    accurate here when its result is not refitted.
    """
    if len(source) < 4:
        return None
    matrix, _ = cv2.findHomography(
        source, target, cv2.USAC_FAST, threshold, maxIters=_MAX_ITERATIONS, confidence=_CONFIDENCE
    )
    fit = _judged(matrix, MotionModel.HOMOGRAPHY, source, target, threshold)
    if fit is None or fit.count < _REFINABLE:
        return fit
    matrix = fit.matrix
    for _ in range(_REFINEMENTS):
        matrix = _refined(matrix, source, target, threshold)
    refined = _judged(matrix, MotionModel.HOMOGRAPHY, source, target, threshold)
    return refined if refined is not None and refined.count >= _KEPT * fit.count else fit


def fit_affine(source: FloatArray, target: FloatArray, threshold: float) -> MotionFit | None:
    """Fits an affine motion as `fit_homography` fits a homography; None for fewer than 3 pairs."""
    if len(source) < 3:
        return None
    matrix, _ = cv2.estimateAffine2D(source, target, **_linear_options(threshold))
    return _judged_linear(matrix, MotionModel.AFFINE, source, target, threshold)


def fit_similarity(source: FloatArray, target: FloatArray, threshold: float) -> MotionFit | None:
    """Fits shift, rotation and one scale as `fit_homography` does; None for fewer than 2 pairs."""
    if len(source) < 2:
        return None
    matrix, _ = cv2.estimateAffinePartial2D(source, target, **_linear_options(threshold))
    return _judged_linear(matrix, MotionModel.SIMILARITY, source, target, threshold)


_LADDER: Final = ((fit_homography, 1.0), (fit_affine, 0.6), (fit_similarity, 0.4))


def fit_motion(
    source: FloatArray, target: FloatArray, shape: tuple[int, int], limits: FitLimits
) -> tuple[MotionFit | None, MotionFit]:
    """Fits the richest motion that can be believed.

    Args:
        source: float64[n, 2].
        target: float64[n, 2].
        shape: (height, width) of both images, for the plausibility of the motion.
        limits: what the fit must reach.

    Returns:
        The accepted fit or None, and the fit with the most inliers whether accepted or not.
    """
    best = NO_FIT
    for fit_model, share in _LADDER:
        fit = fit_model(source, target, limits.threshold)
        if fit is None:
            continue
        if fit.count > best.count:
            best = fit
        enough = fit.count >= share * limits.min_inliers and fit.ratio >= limits.min_ratio
        if enough and is_plausible(fit.matrix, shape, limits.max_step):
            return fit, best
    return None, best


def _refined(matrix: FloatArray, source: FloatArray, target: FloatArray, threshold: float) -> FloatArray:
    """One Gauss-Newton step of (I + D) `matrix` on the pairs within `_TRIM` times the inliers' median."""
    mapped = project(matrix, source)
    residuals = target - mapped
    squares = np.einsum("ni,ni->n", residuals, residuals)
    close = squares[squares < threshold**2]
    typical = float(np.partition(close, len(close) // 2)[len(close) // 2])
    kept = squares < max(_TRIM**2 * typical, (_LEAST_TRIM * threshold) ** 2)
    middle = target.mean(axis=0)
    size = max(1.0, float(np.abs(target - middle).max()))
    x, y = ((mapped[kept] - middle) / size).T
    count = len(x)
    rows = np.zeros((2, count, 8))
    rows[0, :, 0] = rows[1, :, 3] = x
    rows[0, :, 1] = rows[1, :, 4] = y
    rows[0, :, 2] = rows[1, :, 5] = 1
    rows[0, :, 6] = -x * x
    rows[0, :, 7] = rows[1, :, 6] = -x * y
    rows[1, :, 7] = -y * y
    design = rows.reshape(2 * count, 8)
    wanted = (residuals[kept] / size).T.reshape(-1)
    try:
        step = np.linalg.solve(design.T @ design, design.T @ wanted)
    except np.linalg.LinAlgError:
        return matrix
    change = np.eye(3) + np.append(step, 0.0).reshape(3, 3)
    forth = np.array([[size, 0, middle[0]], [0, size, middle[1]], [0, 0, 1]])
    back = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, size]]) / size
    return normalised(forth @ change @ back @ matrix)


def _linear_options(threshold: float) -> dict[str, Any]:
    return {
        "method": cv2.RANSAC,
        "ransacReprojThreshold": threshold,
        "maxIters": _MAX_ITERATIONS,
        "confidence": _CONFIDENCE,
    }


def _judged_linear(
    matrix: Any, model: MotionModel, source: FloatArray, target: FloatArray, threshold: float
) -> MotionFit | None:
    if matrix is None:
        return None
    return _judged(np.vstack([matrix, [0.0, 0.0, 1.0]]), model, source, target, threshold)


def _judged(
    matrix: Any, model: MotionModel, source: FloatArray, target: FloatArray, threshold: float
) -> MotionFit | None:
    if matrix is None or not math.isfinite(float(matrix.sum())) or abs(matrix[2, 2]) < 1e-12:
        return None
    matrix = normalised(np.asarray(matrix, dtype=np.float64))
    residuals = project(matrix, source) - target
    squares = np.einsum("ni,ni->n", residuals, residuals)
    inliers = squares < threshold**2
    count = int(np.count_nonzero(inliers))
    rmse = math.sqrt(float(squares[inliers].sum()) / count) if count else 0.0
    return MotionFit(matrix, model, inliers, rmse)
