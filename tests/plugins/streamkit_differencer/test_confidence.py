"""How sure detections are."""

import numpy as np

from streamkit_differencer.confidence import LONG_ENOUGH_FRAMES, Persistence, confidence, contrasts


def test_each_part_counts():
    """More contrast, a longer life and a better registration are surer, and nothing exceeds 1."""
    contrast, ages = np.array([1.0, 2.0, 5.0]), np.full(3, 2.0)
    assert (np.diff(confidence(contrast, ages, 1.0)) > 0).all()
    assert (np.diff(confidence(np.full(3, 2.0), np.array([1.0, 2.0, 4.0]), 1.0)) > 0).all()
    assert (confidence(contrast, ages, 0.5) < confidence(contrast, ages, 1.0)).all()
    assert confidence(np.array([1e6]), np.array([1e6]), 1.0).max() <= 1.0
    assert confidence(np.zeros(1), np.ones(1), 1.0).tolist() == [0.0]


def test_ages_follow_overlapping_boxes():
    """A box that overlaps one of the frame before is the same object; another is new."""
    persistence = Persistence()
    for age in range(1, LONG_ENOUGH_FRAMES + 2):
        left = 3.0 * age
        assert persistence.update(np.array([[left, 0, left + 10, 10]])).tolist() == [age]
    assert persistence.update(np.array([[90.0, 50, 99, 60]])).tolist() == [1]
    assert persistence.update(np.zeros((0, 4))).shape == (0,)
    assert persistence.update(np.array([[90.0, 50, 99, 60]])).tolist() == [1]


def test_boxes_move_with_the_canvas():
    """A scroll of the canvas makes nothing new."""
    persistence = Persistence()
    persistence.update(np.array([[0.0, 0, 10, 10]]))
    persistence.boxes = persistence.boxes + 100.0
    assert persistence.update(np.array([[100.0, 100, 110, 110]])).tolist() == [2]


def test_contrast_is_in_multiples_of_the_threshold():
    """The mean of the points that exceed it, on the canvas; 0 where none does or nothing is known."""
    shape = (60, 80)
    image, background, thresholds, known = (np.full(shape, value, np.uint8) for value in (100, 100, 10, 255))
    image[20:40, 20:30] = 130
    image[:, 60:], known[:, 60:] = 200, 0
    boxes = np.array([[0.0, 0, 39, 39], [40, 0, 50, 10], [100, 0, 118, 30], [-1e9, -1e9, 1e9, 1e9]])
    halving = np.diag([0.5, 0.5, 1.0]) + np.array([[0, 0, 20], [0, 0, 20], [0, 0, 0]])
    found = contrasts(boxes, halving, image, background, thresholds, known)
    np.testing.assert_allclose(found[:3], [3.0, 0.0, 0.0])
    assert np.isfinite(found).all()
    assert contrasts(np.zeros((0, 4)), halving, image, background, thresholds, known).shape == (0,)
