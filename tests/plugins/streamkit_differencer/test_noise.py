"""Noise of each pixel."""

import numpy as np

from streamkit_differencer.ground import DEVIATION_STEPS, KNOWN, PROVISIONAL
from streamkit_differencer.noise import DEVIATION_RATIO, find_measured, find_thresholds, learn_noise

RATES = np.float32(0.2), np.float32(0.4)


def deviations(values):
    """Deviations in grey levels, as they are kept."""
    return (DEVIATION_STEPS * np.array(values)).astype(np.uint8)


def test_the_deviation_of_noise_is_learnt():
    """After some hundred frames the mean deviation is that of the noise, pixel by pixel, within a tenth."""
    random, wanted = np.random.default_rng(0), np.repeat([2.0, 5.0, 9.0], 400)
    deviation, background = deviations([5.0] * 1200), np.zeros(1200, np.uint8)
    averaged, valid = np.full(1200, 255, np.uint8), np.full(1200, KNOWN, np.uint8)
    for _ in range(300):
        image = np.abs(np.round(random.normal(0.0, wanted))).astype(np.uint8)
        learn_noise(image, background, averaged, averaged, np.zeros_like(image), valid, RATES, deviation)
    found = DEVIATION_RATIO * deviation.reshape(3, 400).mean(axis=1) / DEVIATION_STEPS
    np.testing.assert_allclose(found, [2.0, 5.0, 9.0], rtol=0.1)


def test_ground_that_was_never_quiet_learns_at_a_rate_of_its_own():
    """Not where it is foreground, and known ground that is not at rest learns nothing."""
    image, background = np.full(3, 20, np.uint8), np.full(3, 10, np.uint8)
    valid = np.array([PROVISIONAL, PROVISIONAL, KNOWN], np.uint8)
    mask, deviation = np.array([0, 255, 0], np.uint8), deviations([5.0] * 3)
    measured = np.full_like(image, 255)
    learn_noise(image, background, measured, np.zeros_like(image), mask, valid, RATES, deviation)
    np.testing.assert_array_equal(deviation, deviations([7.0, 5.0, 5.0]))


def test_thresholds_are_bounded():
    """So many mean deviations, between the smallest and the largest."""
    deviation, found = deviations([1.0, 5.0, 15.0]), np.empty(3, np.uint8)
    find_thresholds(deviation, np.float32(4.4), np.float32(10.0), found)
    assert found.tolist() == [10, 22, 60]
    find_thresholds(deviation, np.float32(0.0), np.float32(22.0), found)
    assert found.tolist() == [22, 22, 22]


def test_groups_of_pixels_that_stay_the_same_are_not_measured():
    """A group of eight shows noise if one of its pixels changed; what is left over is a group, too."""
    last = np.arange(28, dtype=np.uint8)
    image, measured = last.copy(), np.empty_like(last)
    image[[4, 27]] += 1
    find_measured(image, last, measured)
    assert np.flatnonzero(measured).tolist() == [*range(8), *range(24, 28)]
