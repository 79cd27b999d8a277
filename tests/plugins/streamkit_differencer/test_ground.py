"""Images of the canvas, scrolled and warped."""

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_differencer.ground import KNOWN, UNKNOWN_DEVIATION, Ground, scrolled, warped

SHAPE = (30, 50)


@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (4, -9), (-7, 3), (49, 29), (-60, 2), (3, 31)])
def test_scrolling_moves_pixels(dx, dy):
    """What was at (x, y) is at (x + dx, y + dy); what enters is filled."""
    image = np.random.default_rng(0).integers(1, 255, SHAPE).astype(np.uint8)
    moved = scrolled(image, dx, dy, 7)
    for y, x in np.ndindex(SHAPE):
        inside = 0 <= y - dy < SHAPE[0] and 0 <= x - dx < SHAPE[1]
        assert moved[y, x] == (image[y - dy, x - dx] if inside else 7)


def test_warping_by_whole_pixels_is_scrolling():
    """And what enters is filled."""
    image = np.random.default_rng(1).integers(1, 255, SHAPE).astype(np.float32)
    np.testing.assert_array_equal(warped(image, translation((4, -9)), 7), scrolled(image, 4, -9, 7))


def test_what_enters_is_unknown():
    """After a scroll and after a warp; a part is a view."""
    for move in (lambda ground: ground.scroll(10, 0), lambda ground: ground.warp(translation((10, 0)))):
        ground = Ground.unknown((50, 30))
        part = ground.part(np.s_[:, :])
        part.valid[:], part.deviation[:] = KNOWN, 1.0
        move(ground)
        assert not ground.valid[:, :10].any()
        assert (ground.deviation[:, :10] == UNKNOWN_DEVIATION).all()
        assert (ground.valid[2:-2, 12:-2] == KNOWN).all()
        assert (ground.deviation[2:-2, 12:-2] == 1.0).all()
