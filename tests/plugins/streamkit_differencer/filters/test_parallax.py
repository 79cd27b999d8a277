"""Tall things under a moving camera."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.filters.parallax import parallax_objects

STEP = np.array([12.0, 0.0])


def pictures(shifts):
    """Two pictures of textured squares on plain ground, each moved by its shift, and the squares' boxes."""
    random, boxes = np.random.default_rng(4), []
    earlier, later = np.full((120, 300), 100, np.uint8), np.full((120, 300), 100, np.uint8)
    for index, (dx, dy) in enumerate(shifts):
        tile = cv2.resize(random.integers(0, 255, (10, 10)).astype(np.uint8), (40, 40))
        x, y = 20 + 80 * index, 40
        earlier[y : y + 40, x : x + 40] = tile
        later[y + dy : y + dy + 40, x + dx : x + dx + 40] = tile
        boxes.append([x + dx, y + dy, x + dx + 40, y + dy + 40])
    return earlier, later, np.array(boxes, float)


@pytest.mark.parametrize(
    ("shift", "expected"),
    [((-2, 0), True), ((0, 0), True), ((3, 0), False), ((0, 3), False), ((-9, 0), False)],
    ids=["slides-back", "stands", "along", "across", "faster-than-tall"],
)
def test_what_slides_against_the_camera_is_parallax(shift, expected):
    """Only against the camera's motion, and by no more than the height allows; what stands is no mover."""
    earlier, later, boxes = pictures([shift])
    assert parallax_objects(earlier, later, boxes, STEP, 0.3).tolist() == [expected]


def test_each_object_is_judged_by_itself():
    """A roof goes, a car stays."""
    earlier, later, boxes = pictures([(-2, 0), (3, 2)])
    assert parallax_objects(earlier, later, boxes, STEP, 0.3).tolist() == [True, False]


def test_a_camera_that_stands_sees_no_parallax():
    """Nor is anything said without objects."""
    earlier, later, boxes = pictures([(-2, 0)])
    assert parallax_objects(earlier, later, boxes, np.zeros(2), 0.3).tolist() == [False]
    assert parallax_objects(earlier, later, np.zeros((0, 4)), STEP, 0.3).shape == (0,)
