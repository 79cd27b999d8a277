"""Dense alignment against exact motions, with movers, and where nothing can agree."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import corner_shift, corners, inverse, project, translation
from streamkit_stitcher.registration.dense_alignment import align_densely
from streamkit_stitcher.registration.dense_level import (
    STEP_RATIOS,
    DenseLevel,
    levels_of,
    texture,
    textures_of,
)
from streamkit_stitcher.registration.tilt import TiltRatio

SHAPE = (180, 320)
LOOSE = np.diag((3.0 * STEP_RATIOS) ** 2)
STEADY = np.diag((0.3 * STEP_RATIOS) ** 2)
WIDE = np.diag([9.0] * 8)


@pytest.fixture
def faint_road(ground):
    """A keyframe with little contrast, uint8[180, 320]."""
    return np.asarray(110 + (ground[300:480, 300:620].astype(float) - 110) / 2, dtype=np.uint8)


def with_cars(image, shift):
    """Three large cars of strong contrast on a copy, moved by `shift` px."""
    random = np.random.default_rng(4)
    result = image.copy()
    for left, top in ((40, 20), (150, 90), (240, 40)):
        car = cv2.resize(random.integers(0, 255, (9, 8), dtype=np.uint8), (44, 50))
        result[top + shift : top + shift + 50, left : left + 44] = car
    return result


def levels(image):
    """A keyframe, coarsest first."""
    return [DenseLevel(part) for part in levels_of(image)]


def aligned(key, image, *arguments, **named):
    """An image aligned with a keyframe."""
    return align_densely(key, textures_of(image), *arguments, **named)


def test_a_known_motion_is_found(ground):
    """To a quarter of a pixel at the corners, from a prediction 2 px off."""
    key = ground[300:480, 300:620]
    true = translation(np.array([-2.3, 1.4]))
    frame = cv2.warpPerspective(ground, true @ translation(np.array([-300.0, -300.0])), (320, 180))
    found = aligned(levels(key), frame, [np.eye(3)], LOOSE)
    assert corner_shift(inverse(true) @ found.key_to_frame, SHAPE) < 0.25
    assert found.agreement > 0.8
    assert found.corner_std < 0.25


def test_a_lost_frame_is_found_without_a_prediction(ground):
    """By correlation, 70 px from where the camera was."""
    frame = ground[300:480, 370:690]
    found = aligned(levels(ground[300:480, 300:620]), frame, [np.eye(3)], STEADY, 0.0)
    assert corner_shift(inverse(translation(np.array([-70.0, 0.0]))) @ found.key_to_frame, SHAPE) < 0.25


def test_the_motion_of_three_cars_is_not_the_cameras(faint_road):
    """They agree with a shift by 12 px, the faint road with none."""
    key, frame = with_cars(faint_road, 0), with_cars(faint_road, 12)
    assert aligned(levels(key), frame, [np.eye(3)], STEADY, 0.0).at_rest


def test_a_camera_that_always_rests_is_moved_by_clear_evidence_only(ground):
    """A shift of 2 px of a blurred picture is doubtful, of 3 px it is clear."""
    views = (ground[top : top + 180, 300:620] for top in (300, 302, 303))
    key, near, far = (cv2.GaussianBlur(view, (0, 0), 3) for view in views)
    doubtful, sure, start = 0.0, 1.0, [np.eye(3)]
    assert not aligned(levels(key), near, start, LOOSE, doubtful, doubted=6.0).at_rest
    assert aligned(levels(key), near, start, LOOSE, sure, doubted=6.0).at_rest
    assert not aligned(levels(key), far, start, LOOSE, sure, doubted=6.0).at_rest
    assert aligned(levels(key), near, start, LOOSE, sure, doubted=2.0).at_rest


def test_movers_with_most_of_the_contrast_do_not_move_the_world(faint_road):
    """Cars move by 4 px on a road of little contrast; the camera at rest explains the frame."""
    found = aligned(
        levels(with_cars(faint_road, 0)), with_cars(faint_road, 4), [np.eye(3)], STEADY, rest_share=0.0
    )
    assert found.at_rest
    assert np.array_equal(found.key_to_frame, np.eye(3))


def test_rest_is_not_preferred_to_a_real_motion(ground):
    """A shift of 2 px is no rest."""
    frame = ground[302:482, 300:620]
    found = aligned(levels(ground[300:480, 300:620]), frame, [np.eye(3)], LOOSE, rest_share=0.0)
    assert not found.at_rest
    assert corner_shift(inverse(translation(np.array([0.0, -2.0]))) @ found.key_to_frame, SHAPE) < 0.25


def test_unrelated_frames_agree_by_chance_only(ground):
    """The agreement of another place is near 0, and the predicted error is large."""
    found = aligned(levels(ground[300:480, 300:620]), ground[900:1080, 1200:1520], [np.eye(3)], LOOSE)
    assert found.agreement < 0.12
    assert found.corner_std > 2.0


def test_a_flat_frame_agrees_with_nothing(ground):
    """Without contrast there is no agreement and no error."""
    flat = np.full(SHAPE, 90, np.uint8)
    assert aligned(levels(ground[300:480, 300:620]), flat, [np.eye(3)], LOOSE).agreement < 0.12


def test_evidence_speaks_against_motions_two_pixels_off(ground):
    """Of the right motion against its neighbours, and of a wrong one against the right one."""
    key = ground[300:480, 300:620]
    right = aligned(levels(key), key, [np.eye(3)], STEADY, rest_share=1.0)
    assert right.evidence.min() > 3
    level = levels(key)[-1]
    image = texture(key)
    off = translation(np.array([2.0, 0.0]))
    wrong = level.compare(image, off)
    near = [level.compare(image, off @ step) for step in level.neighbours(2.0)]
    assert min(level.evidence(wrong, one) for one in near) < -3


def test_the_least_certain_motion_is_tested_where_the_scene_is_hidden(ground):
    """It moves a hidden corner by the distance asked for, and less speaks against it; rest is not tested."""
    key, motion = levels(ground[300:480, 300:620]), translation(np.array([-6.0, -3.0]))
    seen = np.ascontiguousarray(ground[303:483, 306:626])
    hidden = seen.copy()
    hidden[:, :200] = ground[1000:1180, 1000:1200]
    whole, part = (aligned(key, frame, [motion], STEADY) for frame in (seen, hidden))
    assert part.bent_evidence < 0.7 * whole.bent_evidence
    assert whole.bent_evidence > 2
    step, back = key[-1].least_certain(part.covariance, 2.0)
    shifts = np.hypot(*(project(step, corners(SHAPE)) - corners(SHAPE)).T)
    assert shifts.max() == pytest.approx(2.0, abs=0.1)
    assert shifts[[0, 3]].max() > shifts[[1, 2]].max()
    assert corner_shift(step @ back, SHAPE) < 0.1
    assert aligned(key, ground[300:480, 300:620], [np.eye(3)], STEADY, rest_share=1.0).bent_evidence == np.inf


def test_a_turn_that_was_not_expected_is_found(ground):
    """A turn by 2 px at the corners, of a camera believed to stand still, is found by its evidence."""
    turn = np.vstack([cv2.getRotationMatrix2D((159.5, 89.5), 0.6, 1.0), [0, 0, 1]])
    moved = turn @ translation(np.array([-300.0, -300.0]))
    found = aligned(
        levels(ground[300:480, 300:620]),
        cv2.warpPerspective(ground, moved, (320, 180)),
        [np.eye(3)],
        np.diag((0.02 * STEP_RATIOS) ** 2),
        rest_share=0.0,
    )
    assert not found.at_rest
    assert corner_shift(inverse(turn) @ found.key_to_frame, SHAPE) < 0.25


def test_shear_and_perspective_of_a_camera_that_does_not_tilt_are_not_taken_from_movers(ground):
    """Three quarters of a frame show something else that moves along, which bends a free motion."""
    key, still = ground[300:480, 300:620], TiltRatio()
    frame = np.ascontiguousarray(ground[300:480, 320:640])
    frame[:, 80:] = ground[1000:1180, 1000:1240]
    true = translation(np.array([-20.0, 0.0]))
    finest = levels(key)[-1]
    for _ in range(30):
        still.learn(finest, true, np.zeros(4), np.full(4, 1e-4))
    found = [aligned(levels(key), frame, [true], WIDE, tilt=tilt) for tilt in (still, TiltRatio())]
    errors = [corner_shift(inverse(true) @ one.key_to_frame, SHAPE) for one in found]
    assert errors[0] < errors[1]
    assert errors[0] < found[0].corner_std < found[1].corner_std / 1.5


def test_what_a_frame_shows_of_its_tilt_does_not_depend_on_the_prior(ground):
    """A camera that was taken not to tilt shows that it does."""
    key, still = ground[300:480, 300:620], TiltRatio()
    finest = levels(key)[-1]
    true = translation(np.array([-20.0, 0.0])) @ finest.matrix_of(np.array([0, 0, 0, 0, 0, 0, 2.0, 0]))
    for _ in range(100):
        still.learn(finest, true, np.zeros(4), np.full(4, 1e-4))
    frame = cv2.warpPerspective(ground, true @ translation(np.array([-300.0, -300.0])), (320, 180))
    found = aligned(levels(key), frame, [true], WIDE, tilt=still)
    assert found.tilt == pytest.approx([0, 0, 2.0, 0], abs=0.5)


def test_a_frame_smaller_than_a_block_agrees_with_nothing():
    """It has no whole block."""
    tiny = np.arange(36, dtype=np.uint8).reshape(6, 6)
    assert aligned(levels(tiny), tiny, [np.eye(3)], LOOSE, 0.0).agreement == 0


def test_no_more_blocks_are_compared_than_tell_something(ground):
    """Of 4800 one of each four neighbours, the one of most contrast; of 880 all."""
    grey = ground[300:780, 300:940].copy()
    grey[8:16, 0:8] = 255 * (np.indices((8, 8)).sum(axis=0) // 2 % 2)
    fine, coarse = DenseLevel(grey), DenseLevel(np.ascontiguousarray(grey[:180, :320]))
    assert len(coarse.centres) == 22 * 40
    assert len(fine.centres) == len(np.unique(fine.centres // 16, axis=0)) == 30 * 40
    assert [3.5, 11.5] in fine.centres.tolist()
