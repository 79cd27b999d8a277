"""Noise of each pixel."""

import numpy as np

from streamkit_differencer.noise import thresholds, update_spread


def test_the_deviation_of_noise_is_learnt():
    """After some hundred frames it is that of the noise, pixel by pixel, within a tenth."""
    random = np.random.default_rng(0)
    deviation = np.repeat([[2.0, 5.0, 9.0]], 400, axis=0)
    spread, background = np.full((400, 3), 6.0, np.float32), np.full((400, 3), 120.0, np.float32)
    everywhere = np.full((400, 3), 255, np.uint8)
    for _ in range(300):
        frame = np.clip(np.round(random.normal(120.0, deviation)), 0, 255).astype(np.uint8)
        update_spread(spread, background, frame, everywhere, 0.02)
    np.testing.assert_allclose(spread.mean(axis=0), [2.0, 5.0, 9.0], rtol=0.1)


def test_pixels_outside_the_mask_learn_nothing():
    """And a mover teaches at most three deviations."""
    spread, background = np.full((1, 2), 4.0, np.float32), np.zeros((1, 2), np.float32)
    update_spread(spread, background, np.full((1, 2), 255, np.uint8), np.array([[255, 0]], np.uint8), 0.5)
    np.testing.assert_allclose(spread, [[8.0, 4.0]])


def test_thresholds_are_bounded():
    """So many deviations, between the smallest and the largest."""
    spread = np.array([[1.0, 5.0, 50.0]], np.float32)
    assert thresholds(spread, 4.0, 10.0, 60.0).tolist() == [[10, 20, 60]]
