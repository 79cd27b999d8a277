"""Gauss-Newton steps and what they leave unknown."""

import numpy as np
import pytest

from streamkit.geometry.homography import corners, project
from streamkit_stitcher.registration.gauss_newton import (
    deviation_at,
    gauss_newton_step,
    scaling_of,
    step_matrix,
    step_parameters,
)

TRUE = np.array([[0.98, 0.06, 12.0], [-0.05, 1.02, -7.0], [3e-5, -2e-5, 1.0]])
SHAPE = (360, 640)


def points(seed, box=((0, 0), (640, 360)), count=80):
    """Points in a box of the frame."""
    return np.random.default_rng(seed).uniform(*box, (count, 2))


def worst(matrix):
    """Worst distance of the corners from their true positions, px."""
    outline = corners(SHAPE)
    return float(np.hypot(*(project(matrix, outline) - project(TRUE, outline)).T).max())


def fitted(source, target, weights, steps=4):
    """Steps from the identity."""
    matrix = np.eye(3)
    for _ in range(steps):
        matrix = gauss_newton_step(matrix, source, target, weights)
    return matrix


def test_a_few_steps_reach_exact_pairs():
    """From the identity to the true homography within a ten thousandth of a pixel."""
    source = points(0)
    assert worst(fitted(source, project(TRUE, source), np.ones(80))) < 1e-4


def test_pairs_of_weight_zero_do_not_count():
    """A quarter of wrong pairs without weight changes nothing."""
    source = points(1)
    target = project(TRUE, source)
    target[:20] += 50
    assert worst(fitted(source, target, (np.arange(80) >= 20).astype(float))) < 1e-4


def test_points_on_a_line_fix_no_homography():
    """Collinear pairs give None or something finite, never an exception."""
    line = np.stack([np.arange(20.0), np.arange(20.0)], axis=1)
    found = gauss_newton_step(np.eye(3), line, line + 1, np.ones(20))
    assert found is None or np.isfinite(found).all()


@pytest.mark.parametrize("box", [((0, 0), (640, 360)), ((0, 0), (200, 360))])
def test_the_deviation_of_the_corners_is_what_draws_of_noise_show(box):
    """Over 200 draws the error of the worst corner is the predicted one, for spread and crowded points."""
    random = np.random.default_rng(2)
    source, noise = points(3, box), 0.2
    errors, foretold = [], []
    for _ in range(200):
        target = project(TRUE, source) + random.normal(0, noise, (80, 2))
        matrix = fitted(source, target, np.ones(80))
        rmse = float(np.sqrt(((project(matrix, source) - target) ** 2).sum(axis=1).mean()))
        errors.append(worst(matrix))
        foretold.append(deviation_at(corners(SHAPE), matrix, source, rmse))
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.median(foretold), rel=0.35)


def test_points_in_a_corner_leave_the_others_unknown():
    """Twenty points in a tenth of the frame, to 0.3 px, may be off by pixels at the far corner."""
    crowded = points(4, ((0, 0), (150, 120)), 20)
    assert deviation_at(corners(SHAPE), TRUE, crowded, 0.3) > 3.0
    assert deviation_at(corners(SHAPE), TRUE, points(5), 0.3) < 0.5
    assert deviation_at(corners(SHAPE), TRUE, crowded[:3], 0.3) == np.inf


def test_a_step_has_the_parameters_of_its_homography():
    """There and back."""
    scaling = scaling_of(points(6))
    step = np.array([[1.01, 0.02, 3.0], [-0.01, 0.99, -2.0], [1e-5, -2e-5, 1.0]])
    assert step_matrix(step_parameters(step, scaling), scaling) == pytest.approx(step, abs=1e-9)
