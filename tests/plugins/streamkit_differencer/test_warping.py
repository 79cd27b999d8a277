"""Frames drawn onto the canvas, masks fetched from it."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.warping import draw, fetch

SHAPE = (60, 90)
TURN = np.array([[0.98, 0.05, 3.3], [-0.04, 1.01, 5.7], [1e-4, -5e-5, 1.0]])


@pytest.mark.parametrize("matrix", [np.eye(3), TURN], ids=["same", "turned"])
def test_a_frame_is_drawn_as_opencv_resamples_it(matrix):
    """Within a grey level, and only within the bounds; a line of an image may have gaps behind it."""
    noise = np.random.default_rng(0).integers(0, 256, (SHAPE[0], 100)).astype(np.uint8)
    image = cv2.GaussianBlur(noise, (5, 5), 1.0)[:, : SHAPE[1]]
    canvas = np.full((70, 100), 7, np.uint8)
    draw(image, np.linalg.inv(matrix), canvas, (8, 50, 10, 80))
    wanted = cv2.warpPerspective(image, matrix, (100, 70), borderMode=cv2.BORDER_REPLICATE)
    inner = np.zeros_like(image)
    inner[3:-3, 3:-3] = 255
    is_inner = cv2.warpPerspective(inner, matrix, (100, 70))[8:50, 10:80] == 255
    assert is_inner.mean() > 0.8
    difference = np.abs(canvas[8:50, 10:80].astype(int) - wanted[8:50, 10:80])
    assert difference[is_inner].max() <= 1
    canvas[8:50, 10:80] = 7
    assert (canvas == 7).all()


def test_beyond_its_border_a_frame_shows_nothing():
    """0 there and in a border of two pixels; its black is 1; with a horizon nothing outside is read."""
    image = np.full((6, 7), 9, np.uint8)
    image[2, 2] = 0
    canvas = np.full((8, 9), 5, np.uint8)
    draw(image, np.array([[1.0, 0, -1], [0, 1, -1], [0, 0, 1]]), canvas, (0, 8, 0, 9))
    wanted = np.zeros((8, 9), np.uint8)
    wanted[3:5, 3:6], wanted[3, 3] = 9, 1
    np.testing.assert_array_equal(canvas, wanted)
    draw(image, np.array([[1.0, 0, 0], [0, 1, 0], [-0.5, 0, 1]]), canvas, (0, 8, 0, 9))
    assert set(np.unique(canvas)) <= {0, 1, 9}


def test_a_mask_is_fetched_by_nearest_neighbours():
    """As OpenCV does it, but for places halfway between two pixels."""
    mask = np.where(np.random.default_rng(1).random((80, 110)) < 0.3, 255, 0).astype(np.uint8)
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    wanted = cv2.warpPerspective(mask, TURN, SHAPE[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE)
    assert (fetch(mask, TURN, *SHAPE) != wanted).mean() < 0.001
