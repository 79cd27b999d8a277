"""Homographies from matches with few inliers, such as those of features."""

import math
from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import FloatArray, project
from streamkit_stitcher.registration.gauss_newton import gauss_newton_step
from streamkit_stitcher.registration.motion_models import MotionFit, MotionModel, evaluate

# Samples; 1000 find a fit that a quarter of the matches support.
_ITERATIONS: Final = 5000
_CONFIDENCE: Final = 0.9999
_STEPS: Final = 15
_FREEDOM: Final = 8.0
_FEWEST: Final = 6.0
_MIN_DEVIATION: Final = 0.1
_MIN_SHARE: Final = 0.01
_NEAR: Final = 16.0


def fit_wide_baseline(
    source: FloatArray, target: FloatArray, threshold: float, fewest: float = 4
) -> MotionFit | None:
    """Fits the homography with the maximum likelihood over inliers and outliers.

    OpenCV proposes one, expectation maximisation refines it. None for degenerate pairs, and where fewer than
    `fewest` agree.

    Args:
        source: points.
        target: points.
        threshold: largest residual of an inlier and largest deviation of the inliers.
        fewest: inliers that are needed, at least 4.
    """
    if len(source) < fewest:
        return None
    matrix, _ = cv2.findHomography(
        source, target, cv2.USAC_ACCURATE, threshold, maxIters=_ITERATIONS, confidence=_CONFIDENCE
    )
    fit = evaluate(matrix, MotionModel.HOMOGRAPHY, source, target, threshold)
    if fit is None or fit.count < fewest:
        return None
    polished = _polished(fit.matrix, source, target, threshold)
    fit = evaluate(polished, MotionModel.HOMOGRAPHY, source, target, threshold)
    return fit if fit is not None and fit.count >= fewest else None


def _polished(matrix: FloatArray, source: FloatArray, target: FloatArray, threshold: float) -> FloatArray:
    """Expectation maximisation from a homography: the likeliest one near it.

    Inliers follow Student's t distribution, as features differ in precision. Some outliers are near, being
    right about another plane; the others are uniform. The shares of the three and the inliers' deviation are
    estimated, too.

    Source: Torr and Zisserman, MLESAC, CVIU 2000; Lange, Little and Taylor, Robust statistical modeling using
    the t distribution, JASA 1989.
    """
    densities = np.empty((3, len(source)))
    densities[2] = 1 / float(np.prod(np.ptp(target, axis=0) + 1))
    near = (_NEAR * threshold) ** 2
    shares, variance = np.full(3, 1 / 3), max(_MIN_DEVIATION, threshold / 2) ** 2
    for _ in range(_STEPS):
        mapped = project(matrix, source)
        residuals = target - mapped
        squares = np.einsum("ni,ni->n", residuals, residuals)
        reach = 1 + squares / (_FREEDOM * variance)
        densities[0] = reach ** (-(_FREEDOM + 2) / 2) / (2 * math.pi * variance)
        densities[1] = np.exp(-squares / (2 * near)) / (2 * math.pi * near)
        weighted = shares[:, np.newaxis] * densities
        beliefs = weighted / weighted.sum(axis=0)
        weights = beliefs[0] * (1 + 2 / _FREEDOM) / reach
        expected = float(beliefs[0].sum())
        better = gauss_newton_step(matrix, source, target, weights) if expected >= _FEWEST else None
        if better is None:
            break
        matrix = better
        shares = np.maximum(beliefs.mean(axis=1), _MIN_SHARE)
        deviation = math.sqrt(float((weights * squares).sum()) / (2 * expected))
        variance = min(max(deviation, _MIN_DEVIATION), max(threshold, _MIN_DEVIATION)) ** 2
    return matrix
