"""Compiled Gauss-Newton steps of a homography."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import project, translation
from streamkit_stitcher.registration.gauss_newton import scaling_of, step_matrix
from streamkit_stitcher.registration.joint_alignment import align_coarsely
from streamkit_stitcher.registration.patch_comparison import probe
from streamkit_stitcher.registration.patch_steps import solve
from streamkit_stitcher.registration.patches import cut_patches, prepare

STEP = np.array([[1 + 2e-4, -1e-4, 0.3], [1e-4, 1 - 1e-4, -0.2], [2e-7, -1e-7, 1.0]])
TURN = np.array([[0.9, -0.3, 60.0], [0.25, 1.3, -40.0], [2e-4, -1e-4, 1.0]])


@pytest.fixture
def centres():
    """A hundred positions all over a frame of 640 x 360."""
    return np.rint(np.random.default_rng(4).uniform([10, 10], [630, 350], (100, 2)))


def solved(centres, shift, information):
    """Displacement by the best step, float64[2, n]; its homography; its normal matrix."""
    scaling, normal, parameters = scaling_of(centres), np.empty((8, 8)), np.empty(8)
    assert solve(centres, scaling, shift, information, normal, parameters)
    step = step_matrix(parameters * scaling[2], scaling)
    return (project(step, centres) - centres).T, step, normal


@pytest.mark.parametrize("weights", ["even", "covariances"])
def test_the_step_moves_the_patches_as_they_were_shifted(centres, weights):
    """Shifts of a small homography are explained to a thousandth of a pixel, whatever counts how much."""
    shift = (project(STEP, centres) - centres).T.copy()
    information = np.random.default_rng(5).uniform(0.5, 2.0, (3, 100))
    information[1] *= 0.2
    if weights == "even":
        information[1], information[2] = 0.0, information[0]
    moves, step, normal = solved(centres, shift, information)
    assert moves == pytest.approx(shift, abs=2e-3)
    assert step == pytest.approx(STEP, abs=2e-3)
    assert normal == pytest.approx(normal.T)


def test_what_counts_more_is_followed_more(centres):
    """One patch in x and another in y have most weight: the step follows them."""
    shift = np.zeros((2, 100))
    shift[0, 3], shift[1, 7] = 0.5, -0.4
    information = np.full((3, 100), 1e-6)
    information[1] = 0.0
    information[0, 3] = information[2, 7] = 1e3
    moves, _, _ = solved(centres, shift, information)
    assert moves[0, 3] == pytest.approx(0.5, abs=2e-3)
    assert moves[1, 7] == pytest.approx(-0.4, abs=2e-3)


def test_patches_on_one_line_fix_no_step(centres):
    """False, and no warning."""
    centres[:, 1] = 5.0
    none = np.zeros((3, 100)), np.empty((8, 8)), np.empty(8)
    assert not solve(centres, np.array([320.0, 5.0, 300.0]), np.zeros((2, 100)), *none)
    even = np.ones((3, 100))
    even[1] = 0.0
    assert not solve(centres, np.array([320.0, 5.0, 300.0]), np.zeros((2, 100)), even, *none[1:])


def probed(centres, frame, matrix):
    """Products, which patches are seen, and the patches."""
    patches = prepare(cut_patches(frame, centres), centres)
    products, seen = np.empty((3, len(centres))), np.empty(len(centres), dtype=np.bool_)
    count = probe(frame, centres, patches.probes, patches.numbers, patches.usable, matrix, products, seen)
    assert count == np.count_nonzero(seen)
    return products, seen, patches


def test_a_patch_is_compared_with_what_the_motion_shows_of_it(ground, centres):
    """Turned, tilted and half as high again: the same as OpenCV's samples of the frame, border included."""
    frame = np.ascontiguousarray(ground[300:660, 300:940])
    products, seen, patches = probed(centres, frame, TURN)
    assert 20 < np.count_nonzero(seen) < 100
    reach = np.arange(-7, 8)
    offsets = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2).astype(float)
    for index in np.flatnonzero(seen):
        slopes = [
            (project(TURN, centres[[index]] + step) - project(TURN, centres[[index]] - step))[0] / 2e-3
            for step in ([1e-3, 0], [0, 1e-3])
        ]
        places = (project(TURN, centres[[index]]) + offsets @ slopes).astype(np.float32)
        sampled = cv2.remap(
            frame.astype(np.float32), places[:, :1], places[:, 1:], 1, borderMode=cv2.BORDER_REPLICATE
        )
        expected = patches.probes[index] @ sampled[:, 0] / sampled.std()
        assert products[:, index] == pytest.approx(expected, abs=0.02)
    assert not products[:, ~seen].any()


@pytest.mark.parametrize("matrix", [np.full((3, 3), np.nan), np.zeros((3, 3)), np.diag([1e300, 1e300, 1.0])])
def test_a_senseless_motion_shows_nothing(ground, centres, matrix):
    """No patch is seen, and nothing beyond the frame is read."""
    assert not probed(centres, np.ascontiguousarray(ground[:360, :640]), matrix)[1].any()


def test_a_frame_smaller_than_a_patch_shows_nothing(ground, centres):
    """12 x 12 px are no room for one."""
    patches = prepare(cut_patches(ground, centres), centres)
    small = np.ascontiguousarray(ground[:12, :12])
    assert align_coarsely(patches, small, np.eye(3), most=100, passes=2, settled=0.5) is None


def test_views_and_frames_that_are_only_read_are_aligned(ground, centres):
    """A part of a larger frame, and one that must not be written, give what a copy gives."""
    whole = ground[300:660, 300:940]
    frozen = whole.copy()
    frozen.setflags(write=False)
    level = prepare(cut_patches(whole, centres), centres)
    found = [
        align_coarsely(level, frame, translation(np.array([0.8, -0.6])), most=100, passes=8, settled=0.2)
        for frame in (whole, frozen, whole.copy())
    ]
    assert np.abs(found[0] - np.eye(3)).max() < 0.05
    assert np.array_equal(found[0], found[2])
    assert np.array_equal(found[1], found[2])
