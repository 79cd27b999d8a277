"""Equation 4 on the canvas."""

import cv2
import numpy as np
import pytest

from streamkit_differencer.pixel_classes import BACKGROUND, LEAST_WEAK, STRONG, UNKNOWN, WEAK, classify
from tests.plugins.streamkit_differencer.paper_equations import foreground

SHAPE = (33, 50)
REGION = (3, 31, 5, 47)
INSIDE = np.s_[3:31, 5:47]
SEEN = np.full(SHAPE, 255, np.uint8)


def levels_of(image, background, thresholds, *, region=REGION, tolerance=0, gain=0.0, weak=1.0, valid=SEEN):
    """What each pixel is; 77 where nothing was written."""
    levels = np.full(image.shape, 77, np.uint8)
    rounded, seen = np.zeros_like(levels), np.full_like(levels, 255)
    valid = seen if valid is SEEN else valid
    classify(image, seen, background, valid, thresholds, rounded, levels, region, tolerance, gain, weak)
    return levels


def scene(seed):
    """An image, a background and thresholds, all random and smooth."""
    random = np.random.default_rng(seed)
    image = cv2.blur(random.integers(0, 256, SHAPE).astype(np.uint8), (3, 3))
    background = cv2.blur(random.uniform(0, 255, SHAPE).astype(np.float32), (3, 3))
    return image, background, random.integers(4, 40, SHAPE).astype(np.uint8)


@pytest.mark.parametrize("seed", range(3))
def test_without_tolerance_it_is_equation_4(seed):
    """Of a background in whole levels; outside the region nothing is written."""
    image, background, _ = scene(seed)
    background = np.rint(background)
    levels = levels_of(image, background, np.full(SHAPE, 22, np.uint8))
    expected = foreground(image, background, 22.0)
    np.testing.assert_array_equal(levels[INSIDE] == STRONG, expected[INSIDE] > 0)
    levels[INSIDE] = 77
    assert (levels == 77).all()


@pytest.mark.parametrize(("tolerance", "gain"), [(0, 0.3), (1, 0.0), (1, 0.4), (2, 0.0), (3, 0.2)])
@pytest.mark.parametrize("seed", range(2))
def test_each_pixel_is_compared_with_the_range_around_it(seed, tolerance, gain):
    """By smallest and largest values within the tolerance, a share of which raises the threshold."""
    image, background, thresholds = scene(seed)
    levels = levels_of(image, background, thresholds, tolerance=tolerance, gain=gain, weak=0.5)[INSIDE]
    now, ground, limits = image[INSIDE], cv2.convertScaleAbs(background[INSIDE]), thresholds[INSIDE]
    square = np.ones((2 * max(tolerance, 1) + 1,) * 2, np.uint8)
    low, high = cv2.erode(ground, square), cv2.dilate(ground, square)
    outside = (
        cv2.max(cv2.subtract(now, high), cv2.subtract(low, now)) if tolerance else cv2.absdiff(now, ground)
    )
    excess = cv2.subtract(outside, cv2.convertScaleAbs(cv2.subtract(high, low), alpha=gain))
    beside = cv2.absdiff(now, ground) > np.maximum(cv2.convertScaleAbs(limits, alpha=0.5), LEAST_WEAK)
    expected = np.where(excess > limits, STRONG, np.where(beside, WEAK, BACKGROUND))
    np.testing.assert_array_equal(levels, expected)


@pytest.mark.parametrize("tolerance", [1, 2])
def test_tolerance_bears_an_error_of_registration(tolerance):
    """An edge that is off by the tolerance is not foreground; by one pixel more it is."""
    background = np.zeros(SHAPE, np.float32)
    background[:, 20:] = 200.0
    within, beyond, thresholds = (
        np.zeros(SHAPE, np.uint8),
        np.zeros(SHAPE, np.uint8),
        np.full(SHAPE, 22, np.uint8),
    )
    within[:, 20 + tolerance :] = beyond[:, 21 + tolerance :] = 200
    assert not (levels_of(within, background, thresholds, tolerance=tolerance)[INSIDE] == STRONG).any()
    assert (levels_of(beyond, background, thresholds, tolerance=tolerance)[INSIDE] == STRONG).any()
    assert (levels_of(within, background, thresholds)[INSIDE] == STRONG).any()


def test_what_is_not_known_is_nothing():
    """Neither foreground nor ground."""
    image, background, thresholds = scene(0)
    valid = SEEN.copy()
    valid[:, 20:] = 0
    levels = levels_of(image, background, thresholds, valid=valid)
    assert (levels[INSIDE][:, 15:] == UNKNOWN).all()
    assert (levels[INSIDE][:, :15] != UNKNOWN).all()
