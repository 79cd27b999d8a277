"""How sure detections are."""

import numpy as np

from streamkit.geometry.homography import project
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
    image, background, thresholds = (np.full(shape, value, np.uint8) for value in (100, 100, 10))
    image[20:40, 20:30] = 130
    image[:, 60:], thresholds[:, 60:] = 200, 255
    boxes = np.array([[0.0, 0, 39, 39], [40, 0, 50, 10], [100, 0, 118, 30], [-1e9, -1e9, 1e9, 1e9]])
    halving = np.diag([0.5, 0.5, 1.0]) + np.array([[0, 0, 20], [0, 0, 20], [0, 0, 0]])
    found = contrasts(boxes, halving, image, background, thresholds)
    np.testing.assert_allclose(found[:3], [3.0, 0.0, 0.0])
    assert np.isfinite(found).all()
    assert contrasts(np.zeros((0, 4)), halving, image, background, thresholds).shape == (0,)


def test_contrast_is_that_of_a_grid_of_points():
    """The same bits as sampling 5 by 5 points with whole arrays, added in their order."""
    random = np.random.default_rng(0)
    image, background = random.integers(0, 256, (2, 70, 90), dtype=np.uint8)
    thresholds = random.integers(0, 40, (70, 90), dtype=np.uint8)
    thresholds[random.random((70, 90)) < 0.2] = 255
    low = random.uniform(-20, 100, (50, 2))
    boxes = np.hstack([low, low + random.uniform(1, 40, (50, 2))])
    matrix = np.array([[0.9, 0.1, 3.3], [-0.1, 1.1, 2.7], [1e-4, -2e-4, 1.0]])
    steps = (np.arange(5) + 0.5) / 5
    grid = np.array([[x, y] for y in steps for x in steps])
    points = project(matrix, (low[:, None] + (boxes[:, None, 2:] - low[:, None]) * grid).reshape(-1, 2))
    columns, rows = np.rint(np.clip(points, 0, [89, 69])).astype(int).T
    difference = np.abs(image[rows, columns].astype(float) - background[rows, columns])
    excess = (difference / np.maximum(thresholds[rows, columns], 1)).reshape(50, 25)
    counts = excess > 1.0
    expected = (excess * counts).cumsum(axis=1)[:, -1] / np.maximum(counts.sum(axis=1), 1)
    found = contrasts(boxes, matrix, image, background, thresholds)
    np.testing.assert_array_equal(found, expected)
