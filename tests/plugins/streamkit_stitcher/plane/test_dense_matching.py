"""Dense matching with a keyframe: what a camera at rest is believed, and when no longer."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import corner_shift, inverse, translation
from streamkit_stitcher.plane.dense_matching import DenseMatcher
from streamkit_stitcher.plane.frame_registration import OK_STD
from streamkit_stitcher.plane.keyframe_content import keyframe_content
from streamkit_stitcher.plane.keyframes import Keyframe
from streamkit_stitcher.registration.patches import pyramid

SHAPE = (120, 160)


@pytest.fixture
def scene(ground):
    """What the keyframe shows, uint8[120, 160]."""
    return np.ascontiguousarray(ground[300:420, 300:460])


@pytest.fixture
def keyframe(scene):
    """A keyframe of the scene at working size."""
    content = keyframe_content(pyramid((scene,), 4), 0)
    return Keyframe(0, np.eye(3), SHAPE, 1, lambda: content)


def hidden(frame, seed, columns):
    """A frame whose first columns show something else each time, as moving leaves do."""
    result = frame.copy()
    result[:, :columns] = np.random.default_rng(seed).integers(0, 255, (len(frame), columns), dtype=np.uint8)
    return result


def deviations(keyframe, frames):
    """The predicted error of each frame of a camera that is taken to be at rest, px."""
    matcher, before, found = DenseMatcher(), np.eye(3), []
    for frame in frames:
        match = matcher.match(keyframe, frame, before, 0.3, before)
        before = match.fit.matrix
        found.append(match.corner_std)
    return np.array(found)


def test_a_camera_at_rest_is_sure_behind_movers(keyframe, scene):
    """Half of the frame shows the scene where it was."""
    found = deviations(keyframe, (hidden(scene, seed, 80) for seed in range(10)))
    assert (found[1:] < OK_STD).all()


def moving_deviations(keyframe, ground, seen_from):
    """The predicted error of frames of a noisy camera that moves by 1.7 px each, px, from the fourth on.

    A frame shows something else left of column `seen_from`.
    """
    matcher, before, found = DenseMatcher(), np.eye(3), []
    for seed in range(10):
        moved = translation(np.array([1.5 * seed, 0.7 * seed]))
        view = cv2.warpPerspective(
            ground, inverse(translation(np.array([300.0, 300.0])) @ moved), SHAPE[::-1]
        )
        noise = 10.0 * np.random.default_rng(seed).standard_normal(SHAPE)
        frame = np.clip(np.rint(view + noise), 0, 255).astype(np.uint8)
        match = matcher.match(keyframe, hidden(frame, seed, seen_from), before, 0.3, before)
        before = match.fit.matrix
        found.append(match.corner_std)
    return np.array(found[3:])


def test_noise_does_not_make_a_moving_frame_weak(keyframe, ground):
    """Noise is as large everywhere, and the parts of the frame agree on the motion."""
    assert (moving_deviations(keyframe, ground, 0) < OK_STD).all()


def test_a_moving_frame_is_weak_where_a_few_parts_show_the_scene(keyframe, ground):
    """Five eighths of the frame show something else: the rest does not fix the far corners."""
    assert (moving_deviations(keyframe, ground, 100) > OK_STD).all()


def test_a_camera_that_shakes_about_one_place_is_not_taken_to_rest_there(keyframe, ground):
    """Each frame lies so near its keyframe that rest explains it behind leaves, but not all of them."""
    matcher, errors, shakes = DenseMatcher(), [], []
    for seed in range(40):
        moved = translation(np.random.default_rng(seed).normal(0.0, 0.6, 2))
        view = cv2.warpPerspective(ground, translation(np.array([-300.0, -300.0])) @ moved, SHAPE[::-1])
        match = matcher.match(keyframe, hidden(view, seed, 80), np.eye(3), 0.3, np.eye(3))
        errors.append(corner_shift(match.fit.matrix @ moved, SHAPE))
        shakes.append(corner_shift(moved, SHAPE))
    assert np.median(errors[20:]) < 0.4 * np.median(shakes[20:])


def test_a_frame_that_shows_nothing_known_is_not_believed(keyframe, scene):
    """A new camera whose frames hide the scene may be anywhere; a position that agrees by chance is weak."""
    found = deviations(keyframe, (hidden(scene, seed, 160) for seed in range(10)))
    assert (found > OK_STD).all()


def test_doubt_grows_while_the_scene_is_hidden(keyframe, scene):
    """After twenty frames at rest, three that show nothing known, and three more of the scene."""
    frames = [hidden(scene, seed, 160 if 20 <= seed < 23 else 40) for seed in range(26)]
    found = deviations(keyframe, frames)
    assert found[19] < found[20] < found[21] < found[22]
    assert (found[23:] < OK_STD).all()


def test_a_comparison_with_another_motion_teaches_nothing(keyframe, scene):
    """A camera at rest is as sure as before, however often its frames are compared with a mover's motion."""
    asked, plain, rest = DenseMatcher(), DenseMatcher(), np.eye(3)
    for seed in range(10):
        frame = hidden(scene, seed, 80)
        moved = translation(np.array([6.0, 0.0]))
        asked.match_from(keyframe, np.roll(frame, -6, axis=1), moved, 5.0)
        with_question = asked.match(keyframe, frame, rest, 0.3, rest)
        without = plain.match(keyframe, frame, rest, 0.3, rest)
        assert with_question.corner_std == without.corner_std
        assert np.array_equal(with_question.fit.matrix, without.fit.matrix)


def test_a_camera_that_moves_by_similarities_is_known_where_movers_hide_the_scene(keyframe, ground):
    """Half of a frame fixes all of it, once others have shown that the camera does not tilt."""
    matchers, before = (DenseMatcher(), DenseMatcher()), np.eye(3)
    for step in range(1, 21):
        frame = np.ascontiguousarray(ground[300:420, 300 + step : 460 + step])
        before = matchers[0].match(keyframe, frame, before, 0.1, before).fit.matrix
    frame = hidden(np.ascontiguousarray(ground[300:420, 321:481]), 1, 80)
    moved = translation(np.array([21.0, 0.0]))
    known, unknown = (matcher.match_from(keyframe, frame, moved, 0.1) for matcher in matchers)
    errors = [corner_shift(inverse(moved) @ match.fit.matrix, SHAPE) for match in (known, unknown)]
    assert errors[0] < 0.7 * errors[1]
