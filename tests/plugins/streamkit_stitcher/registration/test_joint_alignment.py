"""All patches of a keyframe aligned at once."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import corners, project, translation
from streamkit_stitcher.registration.corners import even_corners
from streamkit_stitcher.registration.joint_alignment import align_coarsely, align_jointly
from streamkit_stitcher.registration.patches import cut_patches, prepare, spread_order

SHAPE = (360, 640)
TURN = np.array([[1.05, -0.12, 20.0], [0.11, 1.04, -15.0], [2e-5, -1e-5, 1.0]])


def key_level(frame):
    """The patches of a frame, in spread order."""
    points = even_corners(frame, 20, 12)
    points = points[spread_order(len(points))]
    return prepare(cut_patches(frame, points), points)


def seen_through(ground, matrix, seed, noise=3.0):
    """The ground's part as a camera moved by `matrix` sees it, with noise."""
    view = cv2.warpPerspective(ground[300:660, 300:940], matrix, (640, 360), borderMode=cv2.BORDER_REFLECT)
    noisy = view + np.random.default_rng(seed).normal(0, noise, SHAPE)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def worst(found, true):
    """Worst distance between corners, px."""
    outline = corners(SHAPE)
    return float(np.hypot(*(project(found, outline) - project(true, outline)).T).max())


def test_a_far_guess_is_improved(ground):
    """From 3 px off, and turned and tilted, the motion comes out right to a quarter of a pixel."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    frame = seen_through(ground, TURN, 2)
    start = translation(np.array([2.5, -1.5])) @ TURN
    found = align_coarsely(level, frame, start, most=60, passes=8, settled=0.2)
    assert worst(found, TURN) < 0.25


def test_all_patches_together_place_a_frame_to_a_twentieth_of_a_pixel(ground):
    """With 3 grey levels of noise on both frames; the reported deviation is of the error's size."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    errors, told = [], []
    for seed in range(2, 8):
        start = translation(np.array([0.3, -0.2])) @ TURN
        found = align_jointly(level, seen_through(ground, TURN, seed), start, 1.0)
        errors.append(worst(found.key_to_frame, TURN))
        told.append(found.deviation)
        assert len(found.numbers) <= found.compared <= found.visible_count
        assert found.rmse < 0.3
    assert np.median(errors) < 0.05
    assert 0.3 < np.median(errors) / np.median(told) < 3.0


def test_what_moves_by_itself_is_left_out(ground):
    """A quarter of the frame that slides by 2 px moves nothing else, and hardly any of it agrees."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    frame = seen_through(ground, np.eye(3), 2)
    frame[:180, 2:320] = frame[:180, :318].copy()
    found = align_jointly(level, frame, translation(np.array([0.2, 0.2])), 1.0)
    assert worst(found.key_to_frame, np.eye(3)) < 0.1
    sliding = (level.centres < (300, 160)).all(axis=1)
    agreeing = (found.key_points < (300, 160)).all(axis=1)
    assert agreeing.sum() < 0.2 * sliding.sum()


def test_roofs_do_not_bend_the_plane(ground):
    """Four bright roofs, of more contrast than all the ground, slide by 0.6 px: they tell nothing."""
    faint = cv2.addWeighted(ground, 0.4, ground, 0.0, 40.0)
    frames = []
    for number, shift in enumerate((0.0, 0.6)):
        frame = seen_through(faint, np.eye(3), number)
        for x, y in ((40, 40), (150, 60), (60, 200), (320, 40)):
            outline = np.array([[x, y], [x + 60, y], [x + 60, y + 45], [x, y + 45]]) + np.array([shift, 0.0])
            cv2.fillPoly(frame, [np.rint(outline * 16).astype(np.int32)], 235, cv2.LINE_AA, 4)
        frames.append(frame)
    found = align_jointly(key_level(frames[0]), frames[1], np.eye(3), 1.0)
    assert worst(found.key_to_frame, np.eye(3)) < 0.12
    assert len(found.off_plane) > 10
    assert not set(found.off_plane) & set(found.on_plane)
    assert np.isinf(found.variances[np.isin(found.numbers, found.off_plane)]).all()


@pytest.mark.parametrize("brightness", [0, 255])
def test_nothing_is_found_in_a_flat_frame(ground, brightness):
    """None, and no warning."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    flat = np.full(SHAPE, brightness, np.uint8)
    assert align_jointly(level, flat, np.eye(3), 1.0) is None
    assert align_coarsely(level, flat, np.eye(3), most=240, passes=4, settled=0.5) is None


def test_a_frame_out_of_view_is_not_found(ground):
    """A prediction that puts every patch outside the frame gives None."""
    level = key_level(seen_through(ground, np.eye(3), 1))
    background = translation(np.array([5000.0, 0.0]))
    assert align_jointly(level, seen_through(ground, np.eye(3), 2), background, 1.0) is None
