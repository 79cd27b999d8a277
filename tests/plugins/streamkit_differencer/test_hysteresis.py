"""Foreground grown to the whole of objects."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.hysteresis import hysteresis_mask, strong_mask
from streamkit_differencer.pixel_classes import BACKGROUND, STRONG, UNKNOWN, WEAK


def grown(levels, region=None):
    """The foreground of an image of levels; 77 where nothing was written."""
    mask, scratch = np.full(levels.shape, 77, np.uint8), np.full(levels.shape, 55, np.uint8)
    hysteresis_mask(levels.copy(), scratch, mask, region or (0, levels.shape[0], 0, levels.shape[1]))
    return mask


@pytest.mark.parametrize("density", [0.001, 0.05, 0.4])
@pytest.mark.parametrize("seed", range(3))
def test_growth_is_a_median_and_two_steps_through_what_is_weak(seed, density):
    """As whole images would be filtered one after the other; outside the region nothing is written."""
    random, shape = np.random.default_rng(seed), (70, 90)
    levels = np.where(random.random(shape) < 0.5, WEAK, BACKGROUND).astype(np.uint8)
    levels[random.random(shape) < 0.1] = UNKNOWN
    levels[cv2.dilate((random.random(shape) < density).astype(np.uint8), np.ones((4, 4))) > 0] = STRONG
    region, inside = (5, 66, 3, 88), np.s_[5:66, 3:88]
    part = levels[inside]
    expected = cv2.medianBlur(np.where(part == STRONG, 255, 0).astype(np.uint8), 3)
    allowed = (part >= WEAK) | ((part == BACKGROUND) & (expected > 0))
    for _ in range(2):
        expected = np.where(allowed, cv2.dilate(expected, np.ones((5, 5), np.uint8)), 0)
    mask = grown(levels, region)
    np.testing.assert_array_equal(mask[inside], expected)
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
