"""Noise of each pixel."""

import numpy as np

from streamkit_differencer.noise import DEVIATION_RATIO, first_spread, thresholds, update_spread


def test_the_deviation_of_noise_is_learnt():
    """After some hundred frames the mean deviation is that of the noise, pixel by pixel, within a tenth."""
    random = np.random.default_rng(0)
    deviation = np.repeat([[2.0, 5.0, 9.0]], 400, axis=0)
    spread, background = np.full((400, 3), 6.0, np.float32), np.full((400, 3), 120, np.uint8)
    everywhere = np.full((400, 3), 255, np.uint8)
    for _ in range(300):
        frame = np.clip(np.round(random.normal(120.0, deviation)), 0, 255).astype(np.uint8)
        update_spread(spread, background, frame, everywhere, everywhere, 0.02)
    np.testing.assert_allclose(DEVIATION_RATIO * spread.mean(axis=0), [2.0, 5.0, 9.0], rtol=0.1)


def test_pixels_outside_the_mask_learn_nothing():
    """And a mover that was missed teaches at most what it is allowed to."""
    spread, background = np.full((1, 2), 4.0, np.float32), np.zeros((1, 2), np.uint8)
    most, mask = np.full((1, 2), 12, np.uint8), np.array([[255, 0]], np.uint8)
    update_spread(spread, background, np.full((1, 2), 255, np.uint8), mask, most, 0.5)
    np.testing.assert_allclose(spread, [[8.0, 4.0]])


def test_thresholds_are_bounded():
    """So many deviations, between the smallest and the largest."""
    spread = np.array([[1.0, 5.0, 50.0]], np.float32)
    assert thresholds(spread / np.float32(DEVIATION_RATIO), 4.0, 10.0, 60.0).tolist() == [[10, 20, 60]]


def test_two_frames_tell_the_noise_of_a_single_one():
    """The mean difference of two frames with noise, whatever moves in a tenth of the picture."""
    random = np.random.default_rng(4)
    first, second = (random.normal(120, 4.0, (400, 600)).round().astype(np.uint8) for _ in range(2))
    second[:40] = 250
    assert abs(first_spread(first, second) - 4.0 * 2 / np.sqrt(np.pi)) < 0.4
    assert first_spread(first, first) > 0
