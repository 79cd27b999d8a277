"""Homographies of image planes."""

import cv2
import numpy as np
import pytest

from streamkit.geometry import homography as h

SHAPE = (720, 1280)
TILTED = np.array([[1.02, 0.03, 12.0], [-0.02, 0.99, -7.0], [1e-5, -2e-5, 1.0]])


def test_inverse_undoes_a_homography():
    """A point mapped forth and back is unchanged."""
    points = h.corners(SHAPE)
    assert h.project(h.inverse(TILTED), h.project(TILTED, points)) == pytest.approx(points, abs=1e-6)


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.ones((3, 3)), np.full((3, 3), np.nan)])
def test_degenerate_matrices_become_the_identity(matrix):
    """Singular and non-finite ones."""
    assert np.array_equal(h.inverse(matrix), np.eye(3))


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.full((3, 3), np.nan), np.ones((3, 3)), np.eye(2)])
def test_a_matrix_without_an_inverse_is_refused(matrix):
    """Singular, NaN or wrongly shaped matrices; a tilted view is taken, at any scale of its elements."""
    assert not h.is_invertible(matrix)
    assert h.is_invertible(TILTED)
    assert h.is_invertible(-7 * TILTED)


def test_a_reduced_homography_maps_the_same_ground():
    """Block averages put reduced pixel x at factor * x + (factor - 1) / 2, and lifting respects it."""
    picture = np.random.default_rng(0).integers(0, 255, (64, 96), dtype=np.uint8)
    moved = np.zeros_like(picture)
    moved[:, 8:] = picture[:, :-8]
    lifted = h.resized(h.translation(np.array([-2.0, 0.0])), 4)
    assert h.project(lifted, np.array([[20.0, 10.0]])) == pytest.approx(np.array([[12.0, 10.0]]))
    reduced, reduced_moved = (cv2.resize(p, (24, 16), interpolation=cv2.INTER_AREA) for p in (picture, moved))
    assert np.array_equal(reduced[:, :-2], reduced_moved[:, 2:])


def test_a_homography_of_reduced_images_is_that_of_the_full_size_ones_again():
    """For any factor."""
    assert h.resized(h.resized(TILTED, 4), 1 / 4) == pytest.approx(TILTED)


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([-1.0, 1.0, 1.0]),
        np.diag([2.0, 2.0, 1.0]),
        np.array([[1, 0, 0], [0, 1, 0], [1e-4, 0, 1.0]]),
        h.translation(np.array([400.0, 0.0])),
        np.full((3, 3), np.nan),
    ],
    ids=["mirror", "scale", "perspective", "step", "nan"],
)
def test_impossible_motions_are_refused(matrix):
    """Mirrored, too large, too tilted, too far and non-finite motions are not plausible."""
    assert not h.is_plausible(matrix, SHAPE, 0.25)


def test_a_flying_camera_is_plausible():
    """A small turn with a little tilt is accepted."""
    assert h.is_plausible(TILTED, SHAPE, 0.25)


@pytest.mark.parametrize("lean", [4e-4, -3e-4])
def test_a_camera_that_looks_aslant_and_turns_is_plausible_where_that_is_allowed(lean):
    """Scale that changes by a quarter from side to side is no motion of one frame, but of a second."""
    across = np.array([[1, 0, 0], [0, 1, 0], [lean, 0, 1.0]])
    middle = h.translation(np.array([320.0, 180.0]))
    turned = h.normalised(middle @ across @ np.linalg.inv(middle))
    assert not h.is_plausible(turned, SHAPE, 10.0)
    assert h.is_plausible(turned, SHAPE, 10.0, max_tilt=1.0)
    assert not h.is_plausible(np.array([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1.0]]), SHAPE, 10.0, max_tilt=1.0)


def test_tilt_is_the_change_of_scale_from_side_to_side():
    """Relative to its least; along either axis; none without perspective, and no end beyond the horizon."""
    assert h.tilt(np.array([[1, 0, 0], [0, 1, 0], [1 / 1280, 0, 1.0]]), SHAPE) == pytest.approx(1.0)
    assert h.tilt(np.array([[1, 0, 0], [0, 1, 0], [0, -1 / 1440, 1.0]]), SHAPE) == pytest.approx(1.0)
    assert h.tilt(h.translation(np.array([9.0, 9.0])), SHAPE) == 0.0
    assert h.tilt(np.array([[1, 0, 0], [0, 1, 0], [-1 / 1200, 0, 1.0]]), SHAPE) == float("inf")


def test_overlap_is_the_shared_part_of_the_footprint():
    """0.5 for a shift by half an image, 0 for a shift by a whole one."""
    assert h.overlap(h.translation(np.array([639.5, 0.0])), SHAPE) == pytest.approx(0.5, abs=1e-3)
    assert h.overlap(h.translation(np.array([2000.0, 0.0])), SHAPE) == 0.0


def test_scale_change_is_linear_magnification():
    """Twice as large in both directions is 2, a mirror is degenerate."""
    assert h.scale_change(np.diag([2.0, 2.0, 1.0]), SHAPE) == pytest.approx(2.0)
    assert h.scale_change(np.diag([-1.0, 1.0, 1.0]), SHAPE) == 0.0


def test_few_and_many_points_are_projected_to_the_same_bits() -> None:
    """However many are mapped at once; a point at infinity comes out as zeros."""
    matrix = np.array([[1.1, 0.02, 3.0], [-0.01, 0.9, 5.0], [1e-4, -2e-4, 1.0]])
    points = np.random.default_rng(4).uniform(-900, 900, (40, 2))
    many = h.project(matrix, points)
    assert np.array_equal(
        np.concatenate([h.project(matrix, points[n : n + 4]) for n in range(0, 40, 4)]), many
    )
    flat = np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, 0]])
    assert h.project(flat, np.array([[0.0, 1.0]])).tolist() == [[0.0, 0.0]]
    assert h.project(flat, np.zeros((20, 2))).tolist() == [[0.0, 0.0]] * 20
