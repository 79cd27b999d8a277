"""Homographies of matches of which few are right."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import corners, project
from streamkit_stitcher.registration.motion_models import MotionModel, least_squares
from streamkit_stitcher.registration.wide_baseline import fit_wide_baseline

TRUE = np.array([[0.9, 0.2, 60.0], [-0.15, 1.1, 40.0], [2e-4, -1e-4, 1.0]])
SHAPE = (720, 1280)


def matches(seed, right=120, wrong=180, deviation=0.7):
    """Right matches, half of them three times as coarse, and wrong ones; best first in no way."""
    random = np.random.default_rng(seed)
    source = random.uniform((0, 0), SHAPE[::-1], (right + wrong, 2))
    target = project(TRUE, source)
    scale = deviation * np.where(np.arange(len(source)) % 2, 1.0, 3.0)
    target += random.normal(0, 1, target.shape) * scale[:, np.newaxis]
    target[right:] = random.uniform((0, 0), SHAPE[::-1], (wrong, 2))
    order = random.permutation(len(source))
    return source[order], target[order]


def error(matrix):
    """Worst distance of the frame's corners from their true positions, px."""
    outline = corners(SHAPE)
    return float(np.hypot(*(project(matrix, outline) - project(TRUE, outline)).T).max())


def test_it_is_nearer_the_truth_than_a_fit_of_those_within_a_threshold():
    """Over six draws of coarse and fine matches the median error is below 0.9 of that of cv2.RANSAC."""
    ours, theirs = [], []
    for seed in range(6):
        source, target = matches(seed)
        ours.append(error(fit_wide_baseline(source, target, 2.0).matrix))
        theirs.append(error(cv2.findHomography(source, target, cv2.RANSAC, 2.0, maxIters=5000)[0]))
    assert np.median(ours) < 0.9 * np.median(theirs)
    assert max(ours) < 5.0


def test_it_is_as_near_the_truth_as_a_fit_of_the_right_matches():
    """Over eight draws, 40 % of the matches right and all as fine, the median is within 15 % of the least."""
    ours, least = [], []
    for seed in range(8):
        random = np.random.default_rng(seed)
        source, target = random.uniform((0, 0), SHAPE[::-1], (2, 400, 2))
        target[:160] = project(TRUE, source[:160]) + random.normal(0, 0.6, (160, 2))
        ours.append(error(fit_wide_baseline(source, target, 2.0).matrix))
        least.append(error(least_squares(MotionModel.HOMOGRAPHY, source[:160], target[:160])))
    assert np.median(ours) < 1.15 * np.median(least)


@pytest.mark.parametrize("deviation", [0.0, 0.2, 2.0])
def test_the_scatter_of_the_matches_need_not_be_known(deviation):
    """Exact, fine and coarse matches are fitted with the same threshold as well as they allow."""
    fit = fit_wide_baseline(*matches(3, deviation=deviation), 4.0)
    assert error(fit.matrix) < 0.05 + 2.5 * deviation


def test_the_second_plane_of_a_street_does_not_pull_the_first():
    """Matches of a smaller plane, moved by a few pixels, count little."""
    source, target = matches(5, deviation=0.3)
    random = np.random.default_rng(6)
    other = random.uniform((700, 400), (1200, 700), (50, 2))
    moved = project(TRUE, other) + np.array([6.0, -5.0])
    fit = fit_wide_baseline(np.concatenate([source, other]), np.concatenate([target, moved]), 2.0)
    assert error(fit.matrix) < 1.0


@pytest.mark.parametrize("count", [0, 3, 4, 12])
def test_few_or_coincident_matches_are_no_error(count):
    """Too few or equal points give None or a finite homography."""
    points = np.full((count, 2), 5.0)
    fit = fit_wide_baseline(points, points, 2.0)
    assert fit is None or np.isfinite(fit.matrix).all()


def test_matches_on_one_line_are_no_error():
    """Collinear matches fix no homography; nothing is raised and nothing is not finite."""
    line = np.stack([np.arange(40.0), np.arange(40.0)], axis=1)
    fit = fit_wide_baseline(line, line + 1, 2.0)
    assert fit is None or np.isfinite(fit.matrix).all()


def test_the_same_matches_give_the_same_fit():
    """Two calls agree bit for bit."""
    first, second = (fit_wide_baseline(*matches(9), 2.0) for _ in range(2))
    assert np.array_equal(first.matrix, second.matrix)
