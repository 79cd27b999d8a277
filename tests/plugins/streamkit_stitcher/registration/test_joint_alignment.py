"""All patches of a key picture aligned at once."""

import cv2
import numpy as np
import pytest

from streamkit_stitcher.homographies import corners, project, translation
from streamkit_stitcher.registration.corners import even_corners
from streamkit_stitcher.registration.joint_alignment import (
    align_coarsely,
    align_jointly,
    joint_level,
    spread_order,
)
from streamkit_stitcher.registration.patches import cut_patches

SHAPE = (360, 640)
TURN = np.array([[1.05, -0.12, 20.0], [0.11, 1.04, -15.0], [2e-5, -1e-5, 1.0]])


def key_level(picture):
    """The patches of a picture, in spread order."""
    points = even_corners(picture, 20, 12)
    numbers = spread_order(len(points))
    return joint_level(cut_patches(picture, points[numbers]), points[numbers], numbers)


def seen_through(ground, matrix, seed, noise=3.0):
    """The ground's part as a camera moved by `matrix` sees it, with noise."""
    view = cv2.warpPerspective(ground[300:660, 300:940], matrix, (640, 360), borderMode=cv2.BORDER_REFLECT)
    noisy = view + np.random.default_rng(seed).normal(0, noise, SHAPE)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def worst(found, true):
    """Worst distance between corners, px."""
    outline = corners(SHAPE)
    return float(np.hypot(*(project(found, outline) - project(true, outline)).T).max())


def test_leading_parts_are_spread():
    """Each number comes once, and of the first eighth no two are close together."""
    order = spread_order(100)
    assert sorted(order) == list(range(100))
    assert np.diff(np.sort(order[:12])).min() >= 4
    assert spread_order(1).tolist() == [0]


def test_a_far_guess_is_improved(ground):
    """From 3 px off, and turned and tilted, the motion comes out right to a quarter of a pixel."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    frame = seen_through(ground, TURN, 2)
    start = translation(np.array([2.5, -1.5])) @ TURN
    found = align_coarsely(level, frame, start, 60, passes=8, settled=0.2)
    assert worst(found, TURN) < 0.25


def test_all_patches_together_place_a_picture_to_a_twentieth_of_a_pixel(ground):
    """With 3 grey levels of noise on both pictures; the deviation that is told is of the error's size."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    errors, told = [], []
    for seed in range(2, 8):
        start = translation(np.array([0.3, -0.2])) @ TURN
        found = align_jointly(level, seen_through(ground, TURN, seed), start, 200, 1.0)
        errors.append(worst(found.key_to_frame, TURN))
        told.append(found.deviation)
        assert len(found.numbers) <= found.compared <= found.sought
        assert found.rmse < 0.3
    assert np.median(errors) < 0.05
    assert 0.3 < np.median(errors) / np.median(told) < 3.0


def test_what_moves_by_itself_is_left_out(ground):
    """A quarter of the picture that slides by 2 px moves nothing else, and hardly any of it agrees."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    frame = seen_through(ground, np.eye(3), 2)
    frame[:180, 2:320] = frame[:180, :318].copy()
    found = align_jointly(level, frame, translation(np.array([0.2, 0.2])), 240, 1.0)
    assert worst(found.key_to_frame, np.eye(3)) < 0.1
    sliding = (level.patches.centres < (300, 160)).all(axis=1)
    agreeing = (found.key_points < (300, 160)).all(axis=1)
    assert agreeing.sum() < 0.2 * sliding.sum()


@pytest.mark.parametrize("brightness", [0, 255])
def test_nothing_is_found_in_a_flat_picture(ground, brightness):
    """None, and no warning."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    flat = np.full(SHAPE, brightness, np.uint8)
    assert align_jointly(level, flat, np.eye(3), 200, 1.0) is None
    assert align_coarsely(level, flat, np.eye(3), 60, passes=4, settled=0.5) is None


def test_a_picture_out_of_view_is_not_found(ground):
    """A guess that puts every patch beside the frame gives None."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    beside = translation(np.array([5000.0, 0.0]))
    assert align_jointly(level, seen_through(ground, np.eye(3), 2), beside, 200, 1.0) is None
