"""Boxes and centroids on the frame itself."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_differencer.canvas import working_to_frame
from streamkit_differencer.objects import Objects, find_objects
from streamkit_differencer.refinement import FrameImages, refine_objects
from streamkit_differencer.settings import ObjectSettings

SHAPE = (120, 160)
SCALE = 2
GROUND = 100
TO_WORKING = np.linalg.inv(working_to_frame(SCALE))


def scene(*things, noise=0.0):
    """A frame with rectangles x0 y0 x1 y1 with fractions of pixels, and the ground at the working scale."""
    fine = np.full((SHAPE[0] * 8, SHAPE[1] * 8), GROUND, np.float32)
    for x0, y0, x1, y1 in np.rint(np.array(things) * 8).astype(int):
        fine[y0:y1, x0:x1] = 220
    frame = cv2.resize(fine, SHAPE[::-1], interpolation=cv2.INTER_AREA)
    frame += noise * np.random.default_rng(4).standard_normal(SHAPE)
    ground = np.full((SHAPE[0] // SCALE, SHAPE[1] // SCALE), GROUND, np.uint8)
    return np.clip(np.rint(frame), 0, 255).astype(np.uint8), ground


def found(frame, ground, threshold=7):
    """Objects as foreground shows them that a tenth of a pixel is enough for, and that foreground."""
    working = cv2.resize(frame, ground.shape[::-1], interpolation=cv2.INTER_AREA)
    mask = np.where(cv2.absdiff(working, ground) > threshold, 255, 0).astype(np.uint8)
    return find_objects(mask, SCALE, ObjectSettings()), mask


# Outer edges in pixels whose centres are whole numbers.
def outer(thing):
    """The box of a rectangle that was painted from corner to corner."""
    return np.array(thing) - 0.5


@pytest.mark.parametrize(
    "thing", [(30.2, 40.3, 61.9, 58.8), (31.0, 41.0, 44.5, 47.5), (50.6, 20.1, 90.4, 33.9)]
)
def test_box_and_centroid_are_those_of_the_thing(thing):
    """To three quarters of a pixel and a quarter of one, where the foreground is a working pixel too wide."""
    frame, ground = scene(thing, noise=2.0)
    coarse, mask = found(frame, ground)
    fine = refine_objects(coarse, FrameImages(frame, ground, TO_WORKING, mask, SCALE))
    assert len(fine) == 1
    middle = (outer(thing)[:2] + outer(thing)[2:]) / 2
    np.testing.assert_allclose(fine.centroids[0], middle, atol=0.25)
    np.testing.assert_allclose(fine.boxes[0], outer(thing), atol=0.75)
    width, height = thing[2] - thing[0], thing[3] - thing[1]
    assert abs(fine.areas[0] / (width * height) - 1) < abs(coarse.areas[0] / (width * height) - 1)


def test_ground_on_a_canvas_is_placed():
    """The background may lie elsewhere, as on the canvas of a camera that flies."""
    thing = (31.0, 41.0, 55.0, 53.0)
    frame, _ = scene(thing)
    # Ground with a step beside the object: placed wrongly, the step would be taken for it.
    frame[:, 58:] = np.where(frame[:, 58:] == GROUND, 180, frame[:, 58:])
    canvas = np.full((90, 120), GROUND, np.uint8)
    canvas[:, 29 + 10 :] = 180
    working = cv2.resize(frame, (80, 60), interpolation=cv2.INTER_AREA)
    mask = np.where(cv2.absdiff(working, canvas[7:67, 10:90]) > 7, 255, 0).astype(np.uint8)
    coarse = find_objects(mask, SCALE, ObjectSettings())
    fine = refine_objects(coarse, FrameImages(frame, canvas, translation((10, 7)) @ TO_WORKING, mask, SCALE))
    np.testing.assert_allclose(fine.boxes[0], outer(thing), atol=0.01)


def test_boxes_that_overlap_are_left_as_they_are():
    """The foreground in each may be the other's."""
    objects = Objects(
        np.array([[20.0, 20.0], [30.0, 26.0]]),
        np.array([[9.5, 9.5, 29.5, 29.5], [19.5, 19.5, 39.5, 31.5]]),
        np.array([300.0, 200.0]),
        np.ones(2),
    )
    frame, ground = scene((10, 10, 28, 28), (22, 22, 38, 30))
    fine = refine_objects(
        objects, FrameImages(frame, ground, TO_WORKING, np.full(ground.shape, 255, np.uint8), SCALE)
    )
    np.testing.assert_array_equal(fine.boxes, objects.boxes)
    np.testing.assert_array_equal(fine.centroids, objects.centroids)


def test_a_thing_without_contrast_is_left_as_it_is():
    """Where the frame shows the ground there is no edge to find."""
    objects = Objects(
        np.array([[20.0, 20.0]]), np.array([[9.5, 9.5, 29.5, 29.5]]), np.array([300.0]), np.ones(1)
    )
    ground = np.full((60, 80), GROUND, np.uint8)
    frame = np.full(SHAPE, GROUND, np.uint8)
    fine = refine_objects(
        objects, FrameImages(frame, ground, TO_WORKING, np.full(ground.shape, 255, np.uint8), SCALE)
    )
    np.testing.assert_array_equal(fine.boxes, objects.boxes)


def test_nothing_gives_nothing():
    """A frame without objects."""
    frame, ground = scene()
    coarse, mask = found(frame, ground)
    assert len(refine_objects(coarse, FrameImages(frame, ground, TO_WORKING, mask, SCALE))) == 0
