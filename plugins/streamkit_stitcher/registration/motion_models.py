"""Robust fits of motion models to point pairs, from the homography down to the similarity."""

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, Final

import cv2
import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, MaskArray, is_plausible, project
from streamkit.settings import setting
from streamkit_stitcher.registration.gauss_newton import gauss_newton_step

_MAX_ITERATIONS: Final = 500
_CONFIDENCE: Final = 0.995
_TRIM: Final = 3.0
_MIN_TRIM: Final = 0.1
_REFINEMENTS: Final = 2
_MIN_REFINABLE: Final = 12


class MotionModel(StrEnum):
    """Motion models by decreasing degrees of freedom."""

    HOMOGRAPHY = "homography"
    AFFINE = "affine"
    SIMILARITY = "similarity"
    TRANSLATION = "translation"


@dataclass(frozen=True, eq=False)
class MotionFit:
    """A motion fitted to point pairs.

    Attributes:
        matrix: float64[3, 3], source points to target points.
        model: the motion model.
        inliers: bool[n], pairs within the threshold.
        rmse: root mean square residual of the inliers, px of the target.
    """

    matrix: FloatArray
    model: MotionModel
    inliers: MaskArray
    rmse: float

    @cached_property
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
    """What a fit must reach to be accepted.

    Attributes:
        max_step: largest displacement of an image corner, as a part of the width.
    """

    ransac_threshold: float = setting(
        1.0, min=0.1, max=20.0, unit="px at registration width", doc="Largest residual of an inlier."
    )
    min_inliers: int = setting(
        20, min=8, max=1000, doc="Fewest inliers of a homography; simpler motion models need fewer."
    )
    min_inlier_ratio: float = setting(
        0.35, min=0.05, max=1.0, doc="Smallest share of inliers among the points in view."
    )
    max_step: float = 0.25


def fit_homography(source: FloatArray, target: FloatArray, threshold: float) -> MotionFit | None:
    """Fits a homography by RANSAC, refined by least squares on the inliers, then on the best of them.

    The last step halves the corner error: slow cars and poorly tracked points pass RANSAC's threshold, but
    not three times the median residual.

    Args:
        source: points.
        target: points.
        threshold: largest residual of an inlier, px of the target.

    Returns:
        The fit, or None for fewer than 4 pairs or degenerate ones.

    Source: Fischler and Bolles, Random sample consensus, CACM 1981. cv2.USAC_MAGSAC is five times less
    accurate here without refinement.
    """
    if len(source) < 4:
        return None
    matrix, _ = cv2.findHomography(
        source, target, cv2.USAC_FAST, threshold, maxIters=_MAX_ITERATIONS, confidence=_CONFIDENCE
    )
    fit = evaluate(matrix, MotionModel.HOMOGRAPHY, source, target, threshold)
    if fit is None or fit.count < _MIN_REFINABLE:
        return fit
    matrix = _refined(fit.matrix, source, target, threshold, _REFINEMENTS)
    return evaluate(matrix, MotionModel.HOMOGRAPHY, source, target, threshold) or fit


def fit_similarity(source: FloatArray, target: FloatArray, threshold: float) -> MotionFit | None:
    """Fits translation, rotation and scale as `fit_homography` does; None for fewer than 2 pairs."""
    if len(source) < 2:
        return None
    matrix, _ = cv2.estimateAffinePartial2D(
        source,
        target,
        method=cv2.RANSAC,
        ransacReprojThreshold=threshold,
        maxIters=_MAX_ITERATIONS,
        confidence=_CONFIDENCE,
    )
    whole = None if matrix is None else np.vstack([matrix, [0.0, 0.0, 1.0]])
    return evaluate(whole, MotionModel.SIMILARITY, source, target, threshold)


def least_squares(model: MotionModel, source: FloatArray, target: FloatArray) -> FloatArray | None:
    """Fits a homography, affine motion or similarity to pairs without outliers; None for degenerate ones."""
    middle, goal = source.mean(axis=0), target.mean(axis=0)
    inner, outer = source - middle, target - goal
    power = float((inner**2).sum())
    if len(source) < 4 or power < 1e-9:
        return None
    matrix: FloatArray = np.eye(3)
    if model is MotionModel.SIMILARITY:
        along = float((inner * outer).sum()) / power
        across = float((inner[:, 0] * outer[:, 1] - inner[:, 1] * outer[:, 0]).sum()) / power
        matrix[:2, :2] = [[along, -across], [across, along]]
    else:
        try:
            matrix[:2, :2] = np.linalg.solve(inner.T @ inner, inner.T @ outer).T
        except np.linalg.LinAlgError:
            return None
    matrix[:2, 2] = goal - matrix[:2, :2] @ middle
    if model is MotionModel.HOMOGRAPHY:
        matrix = _refined(matrix, source, target, math.inf, _REFINEMENTS + 1)
    return np.asarray(matrix, dtype=np.float64)


def restrict(fit: MotionFit, model: MotionModel, source: FloatArray, target: FloatArray) -> MotionFit:
    """Refits a homography's inliers with a simpler model; `fit` where that fails."""
    first, second = source[fit.inliers], target[fit.inliers]
    matrix = least_squares(model, first, second)
    if matrix is None:
        return fit
    lengths = np.hypot(*(project(matrix, first) - second).T)
    near = lengths <= max(_TRIM * float(np.median(lengths)), _MIN_TRIM)
    matrix = least_squares(model, first[near], second[near])
    if matrix is None:
        return fit
    squares = ((project(matrix, first) - second) ** 2).sum(axis=1)
    return MotionFit(matrix, model, fit.inliers, math.sqrt(float(squares.mean())))


_LADDER: Final = ((fit_homography, 1.0), (fit_similarity, 0.4))


def fit_motion(
    source: FloatArray, target: FloatArray, shape: tuple[int, int], limits: FitLimits
) -> tuple[MotionFit | None, MotionFit]:
    """The fit of the most general model that meets the limits, or None, and the fit with the most inliers."""
    best = NO_FIT
    for fit_model, share in _LADDER:
        fit = fit_model(source, target, limits.ransac_threshold)
        if fit is None:
            continue
        if fit.count > best.count:
            best = fit
        enough = fit.count >= share * limits.min_inliers and fit.ratio >= limits.min_inlier_ratio
        if enough and is_plausible(fit.matrix, shape, limits.max_step):
            return fit, best
    return None, best


def _refined(
    matrix: FloatArray, source: FloatArray, target: FloatArray, threshold: float, steps: int
) -> FloatArray:
    """Gauss-Newton iterations on the inliers of `matrix`, on all pairs if `threshold` is infinite."""
    for _ in range(steps):
        residuals = target - project(matrix, source)
        squares = np.einsum("ni,ni->n", residuals, residuals)
        # Pairs whose residual is below a multiple of the median of those within the threshold.
        close = squares[squares < threshold**2]
        typical = float(np.median(close)) if len(close) else 0.0
        inliers = squares < max(_TRIM**2 * typical, (_MIN_TRIM * threshold) ** 2)
        better = gauss_newton_step(matrix, source, target, inliers.astype(np.float64))
        if better is None:
            break
        matrix = better
    return matrix


def evaluate(
    matrix: Any, model: MotionModel, source: FloatArray, target: FloatArray, threshold: float
) -> MotionFit | None:
    """A motion with the pairs within `threshold` px as inliers; None where it is degenerate."""
    if matrix is None or abs(matrix[2, 2]) < 1e-12 or not math.isfinite(sum(matrix.ravel().tolist())):
        return None
    matrix = np.asarray(matrix / matrix[2, 2], dtype=np.float64)
    residuals = project(matrix, source) - target
    squares = np.einsum("ni,ni->n", residuals, residuals)
    inliers = squares < threshold**2
    count = int(np.count_nonzero(inliers))
    rmse = math.sqrt(float(squares[inliers].sum()) / count) if count else 0.0
    return MotionFit(matrix, model, inliers, rmse)
