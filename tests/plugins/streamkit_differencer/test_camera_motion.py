"""The camera's own motion, on images moved by known amounts."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.camera_motion import MAX_MISSED_FRAMES, PAN_FRAMES, RENEWAL_FRAMES, CameraMotion
from streamkit_differencer.image_motion import corner_distance

SHAPE = (240, 320)


def scene(seed=0):
    """Ground with plenty of corners, larger than the view."""
    random = np.random.default_rng(seed)
    coarse = random.uniform(40, 200, (60, 80)).astype(np.float32)
    ground = cv2.resize(coarse, (640, 480), interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(ground, (5, 5), 1.0)


def view(matrix, seed=0, noise=2.0, number=0):
    """What a camera sees that maps its pixels to the ground by `matrix`, from the ground's middle."""
    to_ground = np.array([[1, 0, 160], [0, 1, 120], [0, 0, 1.0]]) @ matrix
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    picture = cv2.warpPerspective(scene(seed), to_ground, SHAPE[::-1], flags=flags)
    random = np.random.default_rng((seed, number))
    return np.clip(np.round(picture + random.normal(0, noise, SHAPE)), 0, 255).astype(np.uint8)


def shaken(random, pixels=3.0):
    """A small random similarity about the middle of the view."""
    turn = np.vstack([cv2.getRotationMatrix2D((160, 120), random.normal(0, 0.3), 1.0), [0, 0, 1]])
    turn[:2, 2] += random.normal(0, pixels, 2)
    return turn


def with_mover(picture, x):
    """The image with a large textured object that moves."""
    changed = picture.copy()
    tile = np.random.default_rng(9).integers(0, 255, (10, 16)).astype(np.uint8)
    changed[60:160, x : x + 128] = cv2.resize(tile, (128, 100), interpolation=cv2.INTER_NEAREST)
    return changed


def test_shaking_is_measured_to_a_third_of_a_pixel():
    """Every frame lies where it was taken, also after a hundred of them: errors do not add up."""
    camera, random = CameraMotion(), np.random.default_rng(1)
    camera.place(view(np.eye(3)))
    for number in range(1, 40):
        truth = shaken(random)
        placed = camera.place(view(truth, number=number))
        assert corner_distance(placed, truth, SHAPE) < 0.35


def test_a_camera_that_stands_still_gives_the_very_same_matrix():
    """Noise moves nothing, so that no frame is resampled, nor does a lorry that fills a third of the view."""
    camera = CameraMotion()
    camera.place(view(np.eye(3)))
    for number in range(1, 15):
        placed = camera.place(with_mover(view(np.eye(3), number=number), 5 * number))
        np.testing.assert_array_equal(placed, np.eye(3))


def test_a_slow_pan_is_followed_over_new_key_pictures():
    """A view that moved by its half is placed within a pixel."""
    camera = CameraMotion()
    for number in range(40):
        truth = np.array([[1, 0, 3.0 * number], [0, 1, 1.0 * number], [0, 0, 1.0]])
        placed = camera.place(view(truth, number=number))
    assert corner_distance(placed, truth, SHAPE) < 1.0


def test_a_step_of_brightness_loses_nothing():
    """Gain and offset are taken out where points are not found at once."""
    camera = CameraMotion()
    camera.place(view(np.eye(3)))
    truth = np.array([[1, 0, 2.0], [0, 1, -1.0], [0, 0, 1.0]])
    brighter = np.clip(0.5 * view(truth, number=1) + 90.0, 0, 255).astype(np.uint8)
    assert corner_distance(camera.place(brighter), truth, SHAPE) < 0.5


@pytest.mark.parametrize("level", [0, 90, 255])
def test_a_plain_picture_is_taken_as_it_lies(level):
    """Where nothing tells of motion the camera counts as still; texture that comes later becomes the key."""
    camera = CameraMotion()
    for _ in range(3):
        np.testing.assert_array_equal(camera.place(np.full(SHAPE, level, np.uint8)), np.eye(3))
    camera.place(view(np.eye(3)))
    truth = np.array([[1, 0, 4.0], [0, 1, 0.0], [0, 0, 1.0]])
    assert corner_distance(camera.place(view(truth, number=1)), truth, SHAPE) < 0.5


def test_black_frames_are_not_placed_and_forget_nothing():
    """After a burst of black the scene is found again where it was, on the same plane."""
    camera = CameraMotion()
    camera.place(view(np.eye(3)))
    plane = camera.plane
    for _ in range(10):
        assert camera.place(np.zeros(SHAPE, np.uint8)) is None
    truth = np.array([[1, 0, 3.0], [0, 1, 2.0], [0, 0, 1.0]])
    assert corner_distance(camera.place(view(truth, number=1)), truth, SHAPE) < 0.5
    assert camera.plane == plane


def test_another_scene_does_not_move_a_camera_that_rests():
    """What covers the view is no motion; when it stays, the camera is measured against it."""
    camera = CameraMotion()
    camera.place(view(np.eye(3)))
    plane = camera.plane
    # The scenes are made of squares, which must not lie on each other.
    there = np.array([[1, 0, 4.0], [0, 1, 4.0], [0, 0, 1.0]])
    for number in range(RENEWAL_FRAMES + 3):
        np.testing.assert_array_equal(camera.place(view(there, seed=5, number=number)), np.eye(3))
    shift = np.array([[1, 0, 4.0], [0, 1, -2.0], [0, 0, 1.0]])
    assert corner_distance(camera.place(view(there @ shift, seed=5, number=99)), shift, SHAPE) < 0.5
    assert camera.plane == plane


def test_a_pan_that_was_missed_ends_the_rest():
    """The view is another one and moves as one: the camera does not wait for the first view to come back."""
    camera = CameraMotion()
    camera.place(view(np.eye(3)))
    for number in range(PAN_FRAMES + 1):
        # Turned, so that the edges of the two scenes, which lie on a grid, do not meet.
        pan = np.vstack([cv2.getRotationMatrix2D((160, 120), 30.0, 1.0), [0, 0, 1]])
        pan[0, 2] += 12.0 * number - 60.0
        camera.place(view(pan, seed=3, number=number))
        assert camera.plane == int(number == PAN_FRAMES)


def test_a_camera_that_moved_and_is_lost_begins_a_new_plane_after_some_patience():
    """Where it looks now is not known: nothing is placed until the old scene is given up."""
    camera, random = CameraMotion(), np.random.default_rng(1)
    for number in range(4):
        camera.place(view(shaken(random), number=number))
    plane = camera.plane
    # The scenes are made of squares, which must not lie on each other.
    there = np.array([[1, 0, 4.0], [0, 1, 4.0], [0, 0, 1.0]])
    for number in range(MAX_MISSED_FRAMES):
        assert camera.place(view(there, seed=5, number=number)) is None
    np.testing.assert_array_equal(camera.place(view(there, seed=5, number=99)), np.eye(3))
    assert camera.plane == plane + 1


def test_a_camera_that_moved_is_followed_where_the_view_changes_slowly():
    """Nothing of the first view is left after a while, as on water; frames show most of those before."""
    camera, random = CameraMotion(), np.random.default_rng(1)
    camera.place(view(np.eye(3)))
    plane = camera.plane
    there = np.array([[1, 0, 4.0], [0, 1, 4.0], [0, 0, 1.0]])
    for number in range(1, 40):
        moved, share = shaken(random), min(number / 30, 1.0)
        first, second = view(moved, number=number), view(there @ moved, seed=5, number=number)
        placed = camera.place(cv2.addWeighted(first, 1.0 - share, second, share, 0.0))
    assert placed is not None
    assert corner_distance(placed, moved, SHAPE) < 1.0
    assert camera.plane == plane


def test_traffic_with_more_corners_than_the_ground_is_no_motion():
    """A third of the view moves as one, and the rest has little texture: the camera stands still."""
    camera, random = CameraMotion(), np.random.default_rng(4)
    load = random.integers(0, 255, (20, 60), np.uint8)
    lorry = cv2.resize(load, (360, 120), interpolation=cv2.INTER_NEAREST)
    for number in range(12):
        picture = view(np.eye(3), number=number)
        picture = cv2.addWeighted(picture, 0.5, picture, 0.0, 40.0)
        picture[80:160, :] = lorry[:80, 3 * number : 3 * number + 320]
        np.testing.assert_array_equal(camera.place(picture), np.eye(3))


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (17, 17)])
def test_tiny_pictures_are_no_error(shape):
    """There are no points to track in them."""
    camera, random = CameraMotion(), np.random.default_rng(2)
    for _ in range(3):
        assert camera.place(random.integers(0, 255, shape, np.uint8)) is not None
