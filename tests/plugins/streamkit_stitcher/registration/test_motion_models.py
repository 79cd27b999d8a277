"""Robust fits of motions to point pairs."""

import numpy as np
import pytest

from streamkit.geometry.homography import project
from streamkit_stitcher.registration.motion_models import (
    FitLimits,
    MotionModel,
    fit_homography,
    fit_motion,
    fit_similarity,
)

SHAPE = (360, 640)
TRUE = np.array([[0.99, 0.05, 6.0], [-0.05, 0.99, -4.0], [2e-5, -1e-5, 1.0]])


def pairs(count, outliers, seed=0, noise=0.1):
    """Point pairs of which the first `outliers` are wrong."""
    random = np.random.default_rng(seed)
    source = random.uniform((0, 0), (640, 360), (count, 2))
    target = project(TRUE, source) + random.normal(0, noise, (count, 2))
    target[:outliers] += random.uniform(5, 40, (outliers, 2))
    return source, target


def test_homography_ignores_outliers():
    """With 40 % of wrong pairs the corners are still right to 0.3 px and the wrong pairs are known."""
    source, target = pairs(200, 80)
    fit = fit_homography(source, target, 1.0)
    corners = np.array([[0, 0], [639, 0], [639, 359], [0, 359]], dtype=float)
    assert np.abs(project(fit.matrix, corners) - project(TRUE, corners)).max() < 0.3
    assert not fit.inliers[:80].any()
    assert fit.ratio == pytest.approx(0.6, abs=0.02)
    assert fit.rmse == pytest.approx(0.1 * np.sqrt(2), rel=0.2)


@pytest.mark.parametrize("fit", [fit_homography, fit_similarity])
@pytest.mark.parametrize("count", [0, 1, 2, 3, 4])
def test_too_few_or_coincident_pairs_are_no_error(fit, count):
    """Nothing, one point and equal points give None or a finite matrix."""
    points = np.full((count, 2), 5.0)
    found = fit(points, points, 1.0)
    assert found is None or np.isfinite(found.matrix).all()


def test_collinear_pairs_are_no_error():
    """Points on one line do not fix a homography; whatever comes back is finite and no exception."""
    line = np.stack([np.arange(30.0), np.arange(30.0)], axis=1)
    accepted, best = fit_motion(line, line + 1, SHAPE, FitLimits())
    assert np.isfinite(best.matrix).all()
    assert accepted is None or np.isfinite(accepted.matrix).all()


def test_the_richest_motion_with_enough_points_is_taken():
    """Many pairs give a homography, few ones a simpler motion, hardly any nothing."""
    limits = FitLimits(min_inliers=20)
    assert fit_motion(*pairs(60, 0), SHAPE, limits)[0].model is MotionModel.HOMOGRAPHY
    assert fit_motion(*pairs(15, 0), SHAPE, limits)[0].model is MotionModel.SIMILARITY
    assert fit_motion(*pairs(6, 0), SHAPE, limits)[0] is None


def test_an_implausible_motion_is_not_taken():
    """Pairs that agree on a mirrored frame are refused."""
    source, _ = pairs(100, 0)
    accepted, _ = fit_motion(source, source * [-1, 1] + [640, 0], SHAPE, FitLimits())
    assert accepted is None
