"""Choosing the motion model by what explains the matches."""

import numpy as np
import pytest

from streamkit.geometry.homography import project
from streamkit_stitcher.registration.model_selection import ModelSelection, MotionRule, gric
from streamkit_stitcher.registration.motion_models import MotionModel, fit_homography, least_squares

SIMILARITY = np.array([[1.02, -0.05, 30.0], [0.05, 1.02, -12.0], [0, 0, 1]])
AFFINE = np.array([[1.02, -0.03, 30.0], [0.05, 0.99, -12.0], [0, 0, 1]])
HOMOGRAPHY = np.array([[1.02, -0.05, 30.0], [0.05, 1.02, -12.0], [1.5e-5, -1e-5, 1]])


def pairs(matrix, seed, noise=0.15, count=200):
    """Matches under a motion."""
    random = np.random.default_rng(seed)
    source = random.uniform([0, 0], [1280, 720], (count, 2))
    return source, project(matrix, source) + random.normal(0, noise, (count, 2))


@pytest.mark.parametrize(
    ("matrix", "model"),
    [
        (SIMILARITY, MotionModel.SIMILARITY),
        (AFFINE, MotionModel.AFFINE),
        (HOMOGRAPHY, MotionModel.HOMOGRAPHY),
    ],
)
def test_the_true_model_is_chosen(matrix, model):
    """Over a few pairs the simplest model that holds has the least criterion."""
    selection = ModelSelection()
    for seed in range(6):
        selection.add(*pairs(matrix, seed))
    assert selection.model is model


def test_without_evidence_the_homography_holds():
    """Before the first pair, and with a handful of points, nothing is ruled out."""
    selection = ModelSelection()
    assert selection.model is MotionModel.HOMOGRAPHY
    selection.add(*pairs(SIMILARITY, 0, count=10))
    assert selection.model is MotionModel.HOMOGRAPHY


def test_a_camera_that_begins_to_tilt_is_noticed():
    """Old evidence fades after a few pairs."""
    selection = ModelSelection(memory=4)
    for seed in range(8):
        selection.add(*pairs(SIMILARITY, seed))
    for seed in range(4):
        selection.add(*pairs(HOMOGRAPHY, seed))
    assert selection.model is MotionModel.HOMOGRAPHY


@pytest.mark.parametrize(
    ("matrix", "model"), [(AFFINE, MotionModel.AFFINE), (HOMOGRAPHY, MotionModel.HOMOGRAPHY)]
)
def test_a_frame_that_tilts_is_not_forced_into_a_simpler_motion(matrix, model):
    """Where keyframes said affine, a frame stays affine unless its own matches speak against it."""
    source, target = pairs(matrix, 3)
    fit = fit_homography(source, target, 2.0)
    assert MotionRule(MotionModel.AFFINE, strict=False).apply(fit, source, target).model is model
    assert MotionRule(MotionModel.AFFINE).apply(fit, source, target).model is MotionModel.AFFINE


@pytest.mark.parametrize("model", [MotionModel.HOMOGRAPHY, MotionModel.AFFINE, MotionModel.SIMILARITY])
def test_least_squares_finds_an_exact_motion(model):
    """Every model recovers a similarity from exact pairs."""
    found = least_squares(model, *pairs(SIMILARITY, 1, noise=0.0))
    assert found / found[2, 2] == pytest.approx(SIMILARITY, abs=1e-6)


def test_least_squares_refuses_coincident_points():
    """Coincident points have no motion."""
    assert least_squares(MotionModel.AFFINE, np.ones((9, 2)), np.ones((9, 2))) is None


def test_more_parameters_cost_more():
    """With equal residuals the simpler model wins."""
    residuals = np.full((50, 2), 0.1)
    assert gric(residuals, 0.01, 4) < gric(residuals, 0.01, 8)
