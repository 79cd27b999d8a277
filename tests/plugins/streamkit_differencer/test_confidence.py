"""How sure detections are."""

import numpy as np

from streamkit_differencer.confidence import LONG_ENOUGH_FRAMES, Persistence, confidence


def test_each_part_counts():
    """More contrast, a longer life and a better registration are surer, and nothing exceeds 1."""
    contrast, ages = np.array([1.0, 2.0, 5.0]), np.full(3, 2.0)
    assert (np.diff(confidence(contrast, ages, 1.0)) > 0).all()
    assert (np.diff(confidence(np.full(3, 2.0), np.array([1.0, 2.0, 4.0]), 1.0)) > 0).all()
    assert (confidence(contrast, ages, 0.5) < confidence(contrast, ages, 1.0)).all()
    assert confidence(np.array([1e6]), np.array([1e6]), 1.0).max() <= 1.0
    assert confidence(np.zeros(1), np.ones(1), 1.0).tolist() == [0.0]


def test_ages_follow_overlapping_boxes():
    """A box that overlaps one of the frame before is the same thing; another is new."""
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
    persistence.follow(lambda boxes: boxes + 100.0)
    assert persistence.update(np.array([[100.0, 100, 110, 110]])).tolist() == [2]
