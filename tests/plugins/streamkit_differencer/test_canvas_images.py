"""Images of the canvas on another canvas."""

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_differencer.canvas_images import scrolled, warped

SHAPE = (120, 160)


@pytest.mark.parametrize(("dx", "dy"), [(5, -3), (-7, 4), (0, 0), (100, 0), (0, -60)])
def test_scrolling_moves_pixels_and_loses_nothing_else(dx, dy):
    """What was at (x, y) is at (x + dx, y + dy); what comes in is filled."""
    image = np.random.default_rng(0).integers(1, 255, SHAPE).astype(np.uint8)
    moved = scrolled(image, dx, dy, 0)
    for y, x in np.ndindex(SHAPE):
        inside = 0 <= y - dy < SHAPE[0] and 0 <= x - dx < SHAPE[1]
        assert moved[y, x] == (image[y - dy, x - dx] if inside else 0)


@pytest.mark.parametrize("seed", range(3))
def test_scrolling_again_and_again_moves_pixels_and_loses_nothing_else(seed):
    """What leaves does not come back, wherever in its memory the image begins."""
    random = np.random.default_rng(seed)
    image = random.uniform(1, 255, SHAPE).astype((np.uint8, np.float32, np.uint8)[seed])
    moved, expected = image.copy(), image.copy()
    for dx, dy in [*random.integers(-25, 26, (60, 2)).tolist(), (0, 0), (0, -300), (200, 1)]:
        moved = scrolled(moved, dx, dy, 7)
        wide = np.full((SHAPE[0] + 600, SHAPE[1] + 600), 7, image.dtype)
        wide[300 + dy : 300 + dy + SHAPE[0], 300 + dx : 300 + dx + SHAPE[1]] = expected
        expected = wide[300 : 300 + SHAPE[0], 300 : 300 + SHAPE[1]].copy()
        assert moved.flags.c_contiguous
        np.testing.assert_array_equal(moved, expected)
        moved[3, 4] = expected[3, 4] = 99


def test_warping_by_whole_pixels_is_scrolling():
    """With nearest neighbours and with cubic interpolation, and what comes in is filled."""
    image = np.random.default_rng(1).integers(1, 255, SHAPE).astype(np.float32)
    np.testing.assert_array_equal(warped(image, translation((4, -9)), 7), scrolled(image, 4, -9, 7))
