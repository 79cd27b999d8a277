"""Frames drawn onto the canvas, masks fetched from it."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.warping import draw, fetch, spans_within

SHAPE = (60, 90)
TURN = np.array([[0.98, 0.05, 3.3], [-0.04, 1.01, 5.7], [1e-4, -5e-5, 1.0]])


@pytest.mark.parametrize("matrix", [np.eye(3), TURN], ids=["same", "turned"])
def test_a_frame_is_drawn_as_opencv_resamples_it(matrix):
    """Within a grey level, and only within the outline; a line of an image may have gaps behind it."""
    noise = np.random.default_rng(0).integers(0, 256, (SHAPE[0], 100)).astype(np.uint8)
    image = cv2.GaussianBlur(noise, (5, 5), 1.0)[:, : SHAPE[1]]
    canvas = np.full((70, 100), 7, np.uint8)
    outline = np.array([[10.0, 8.0], [79.0, 8.0], [79.0, 49.0], [10.0, 49.0]])
    draw(image, np.linalg.inv(matrix), spans_within(outline, 70, 100), canvas)
    wanted = cv2.warpPerspective(image, matrix, (100, 70), borderMode=cv2.BORDER_REPLICATE)
    assert np.abs(canvas[8:50, 10:80].astype(int) - wanted[8:50, 10:80]).max() <= 1
    canvas[8:50, 10:80] = 7
    assert (canvas == 7).all()


def test_a_frame_is_drawn_within_a_slanted_outline():
    """A pixel whose centre is within it, or on it, is drawn, and no other; the canvas may end before it."""
    image, canvas = np.full((70, 100), 200, np.uint8), np.zeros((50, 60), np.uint8)
    outline = np.array([[20.0, -10.0], [90.0, 20.0], [40.0, 45.0], [-10.0, 30.0]])
    draw(image, np.eye(3), spans_within(outline, *canvas.shape), canvas)
    for row, column in np.ndindex(canvas.shape):
        side = cv2.pointPolygonTest(outline.astype(np.float32), (column, row), True)
        assert canvas[row, column] == (200 if side > 0 else 0) or abs(side) < 1e-3


def test_nothing_is_read_beyond_the_border_of_a_frame():
    """It is replicated, also for a matrix with a horizon; black is drawn as 1."""
    image, canvas = np.array([[10, 20], [0, 40]], np.uint8), np.zeros((4, 6), np.uint8)
    everywhere = np.full((4, 2), (0, 6))
    draw(image, np.array([[1.0, 0, -2], [0, 1, -1], [0, 0, 1]]), everywhere, canvas)
    assert canvas.tolist() == [[10, 10, 10, 20, 20, 20]] * 2 + [[1, 1, 1, 40, 40, 40]] * 2
    draw(image, np.array([[1.0, 0, 0], [0, 1, 0], [-0.5, 0, 1]]), everywhere, canvas)
    assert canvas.min() >= 1


def test_a_mask_is_fetched_by_nearest_neighbours():
    """As OpenCV does it, but for positions halfway between two pixels."""
    mask = np.where(np.random.default_rng(1).random((80, 110)) < 0.3, 255, 0).astype(np.uint8)
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    wanted = cv2.warpPerspective(mask, TURN, SHAPE[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE)
    assert (fetch(mask, TURN, *SHAPE) != wanted).mean() < 0.001
