"""Foreground grown to the whole of objects."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.hysteresis import hysteresis_mask, strong_mask
from streamkit_differencer.pixel_classes import BACKGROUND, STRONG, UNKNOWN, WEAK


def grown(levels, region=None):
    """The foreground of an image of levels; 77 where nothing was written."""
    mask = np.full(levels.shape, 77, np.uint8)
    hysteresis_mask(levels.copy(), mask, region or (0, levels.shape[0], 0, levels.shape[1]))
    return mask


def majority(strong, row, column):
    """Whether five of the nine pixels around one are strong; the border is replicated."""
    rows = [min(max(row + step, 0), strong.shape[0] - 1) for step in (-1, 0, 1)]
    columns = [min(max(column + step, 0), strong.shape[1] - 1) for step in (-1, 0, 1)]
    return sum(bool(strong[y, x]) for y in rows for x in columns) >= 5


def near(mask, row, column):
    """Whether any pixel within two is set."""
    return mask[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3].any()


@pytest.mark.parametrize("density", [0.001, 0.05, 0.4])
@pytest.mark.parametrize("seed", range(2))
def test_growth_is_a_median_and_two_steps_through_what_is_weak(seed, density):
    """Pixel by pixel; outside the region nothing is written."""
    random, shape = np.random.default_rng(seed), (40, 50)
    levels = np.where(random.random(shape) < 0.5, WEAK, BACKGROUND).astype(np.uint8)
    levels[random.random(shape) < 0.1] = UNKNOWN
    levels[cv2.dilate((random.random(shape) < density).astype(np.uint8), np.ones((4, 4))) > 0] = STRONG
    region, inside = (5, 36, 3, 48), np.s_[5:36, 3:48]
    part = levels[inside]
    pixels = list(np.ndindex(part.shape))
    expected = np.zeros(part.shape, bool)
    for row, column in pixels:
        expected[row, column] = majority(part == STRONG, row, column)
    allowed = (part >= WEAK) | ((part == BACKGROUND) & expected)
    for _ in range(2):
        expected = np.array([near(expected, *pixel) for pixel in pixels]).reshape(part.shape) & allowed
    mask = grown(levels, region)
    np.testing.assert_array_equal(mask[inside] > 0, expected)
    assert set(np.unique(mask[inside])) <= {0, 255}
    mask[inside] = 77
    assert (mask == 77).all()


def test_weak_differences_count_beside_strong_ones():
    """A grey part that touches a bright one is foreground with it; one that stands alone is not."""
    levels = np.full((40, 60), BACKGROUND, np.uint8)
    levels[10:16, 10:16], levels[10:16, 16:20] = STRONG, WEAK
    levels[30:36, 40:46] = WEAK
    mask = grown(levels)
    assert mask[11:15, 11:19].all()
    assert not mask[25:].any()


def test_strong_pixels_alone():
    """Without growth every strong pixel is foreground, and no other."""
    levels = np.array([[UNKNOWN, BACKGROUND, WEAK, STRONG]], np.uint8)
    mask = np.zeros_like(levels)
    strong_mask(levels, mask, (0, 1, 0, 4))
    assert mask.tolist() == [[0, 0, 0, 255]]
