"""Frames on the canvas, and masks back from it."""

import cv2
import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_differencer.warping import warp_frame, warp_mask_back

SHAPE, CANVAS = (90, 160), (120, 200)
TURNED = translation((22.3, 8.9)) @ np.array([[1.05, 0.06, 0], [-0.06, 1.05, 9], [4e-5, -3e-5, 1]])


def texture(seed=0, shape=SHAPE):
    """A smooth random image."""
    return cv2.GaussianBlur(np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8), (5, 5), 1.2)


def canvas_of(image, place, region=(0, CANVAS[0], 0, CANVAS[1])):
    """The image on a canvas; 77 where nothing is drawn."""
    canvas = np.full(CANVAS, 77, np.uint8)
    warp_frame(image, np.linalg.inv(place), canvas, region)
    return canvas


@pytest.mark.parametrize("place", [TURNED, translation((10.25, 7.5))])
def test_frames_are_drawn_as_by_bilinear_interpolation(place):
    """Within a grey level of OpenCV's, away from the border."""
    size = CANVAS[::-1]
    expected = cv2.warpPerspective(texture(), place, size, flags=cv2.INTER_LINEAR).astype(int)
    inside = (
        cv2.erode(cv2.warpPerspective(np.full(SHAPE, 255, np.uint8), place, size), np.ones((5, 5))) == 255
    )
    difference = np.abs(canvas_of(texture(), place) - expected)[inside]
    assert inside.mean() > 0.4
    assert difference.max() <= 1
    assert difference.mean() < 0.1


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.6, 3.0, -2.2])
def test_a_frame_is_drawn_wherever_it_lies_and_nothing_far_beyond(angle):
    """Turned, partly off the canvas or all of it: each pixel that it covers, none of far away."""
    for x, y in ((100, 60), (10, 20), (190, 130), (500, 60), (100, -400)):
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        place = translation((x, y)) @ turn @ translation((-SHAPE[1] / 2, -SHAPE[0] / 2))
        covered = cv2.warpPerspective(np.full(SHAPE, 255, np.uint8), place, CANVAS[::-1])
        canvas = canvas_of(texture() // 4 + np.uint8(100), place)
        assert (canvas[covered == 255] != 77).all()
        around = cv2.copyMakeBorder(covered, 30, 30, 30, 30, cv2.BORDER_CONSTANT)
        whole = cv2.warpPerspective(
            np.full(SHAPE, 255, np.uint8), translation((30, 30)) @ place, around.shape[::-1]
        )
        far = cv2.dilate(whole, np.ones((29, 29), np.uint8))[30:-30, 30:-30] == 0
        assert (canvas[far] == 77).all()


def test_whole_pixels_are_drawn_as_they_are():
    """And beyond its border the image goes on as on it, within the region alone."""
    image, region = texture(), (10, 110, 15, 190)
    canvas = canvas_of(image, translation((20, 12)), region)
    # The last line and column mix with their neighbours by a part of a pixel that rounding leaves.
    np.testing.assert_array_equal(canvas[12:101, 20:179], image[:-1, :-1])
    np.testing.assert_array_equal(canvas[12:101, 15], image[:-1, 0])
    canvas[10:110, 15:190] = 77
    assert (canvas == 77).all()


@pytest.mark.parametrize("seed", range(3))
def test_masks_are_fetched_as_by_nearest_neighbours(seed):
    """Few objects or many, all of them and nothing else; what lies beyond the canvas is empty."""
    random = np.random.default_rng(seed)
    canvas = np.where(random.random(CANVAS) < (0.001, 0.01, 0.3)[seed], 255, 0).astype(np.uint8)
    canvas = cv2.dilate(canvas, np.ones((4, 4), np.uint8))
    mask = warp_mask_back(canvas, TURNED, np.linalg.inv(TURNED), *SHAPE)
    rows, columns = np.indices(SHAPE)
    x, y, depth = np.tensordot(TURNED, np.stack([columns, rows, np.ones_like(rows)]), axes=1)
    x, y = np.rint(x / depth).astype(int), np.rint(y / depth).astype(int)
    inside = (y >= 0) & (y < CANVAS[0]) & (x >= 0) & (x < CANVAS[1])
    expected = np.where(inside, canvas[np.clip(y, 0, CANVAS[0] - 1), np.clip(x, 0, CANVAS[1] - 1)], 0)
    np.testing.assert_array_equal(mask, expected)
