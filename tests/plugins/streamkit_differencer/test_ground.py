"""Images of the canvas, scrolled and warped."""

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_differencer.ground import DEVIATION_STEPS, KNOWN, UNKNOWN_DEVIATION, Ground, moved

SHAPE = (30, 50)


@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (4, -9), (-7, 3), (49, 29), (-60, 2), (3, 31)])
@pytest.mark.parametrize("is_scroll", [True, False])
def test_shifting_moves_pixels(dx, dy, is_scroll):
    """What was at (x, y) is at (x + dx, y + dy); what enters is filled."""
    image = np.random.default_rng(0).integers(1, 255, SHAPE).astype(np.uint8)
    there = moved(image, translation((dx, dy)), is_scroll, 7)
    for y, x in np.ndindex(SHAPE):
        inside = 0 <= y - dy < SHAPE[0] and 0 <= x - dx < SHAPE[1]
        assert there[y, x] == (image[y - dy, x - dx] if inside else 7)


def test_what_enters_is_unknown():
    """After a scroll and after a warp."""
    for is_scroll in (True, False):
        ground = Ground.unknown((50, 30))
        ground.valid[:], ground.deviation[:] = KNOWN, 1
        ground = ground.moved(translation((10, 0)), is_scroll)
        assert not ground.valid[:, :10].any()
        assert (ground.deviation[:, :10] == UNKNOWN_DEVIATION * DEVIATION_STEPS).all()
        assert (ground.valid[2:-2, 12:-2] == KNOWN).all()
        assert (ground.deviation[2:-2, 12:-2] == 1).all()
