"""Noise of each pixel."""

import numpy as np

from streamkit_differencer.ground import Ground
from streamkit_differencer.noise import (
    DEVIATION_RATIO,
    learn_noise,
    thresholds_of,
)


def test_the_deviation_of_noise_is_learnt():
    """After some hundred frames the mean deviation is that of the noise, pixel by pixel, within a tenth."""
    random, ground = np.random.default_rng(0), Ground.unknown((3, 400))
    everywhere, deviation = np.full((400, 3), 255, np.uint8), np.repeat([[2.0, 5.0, 9.0]], 400, axis=0)
    for _ in range(300):
        difference = np.abs(np.round(random.normal(0.0, deviation))).astype(np.uint8)
        learn_noise(ground, difference, np.zeros_like(everywhere), everywhere)
    np.testing.assert_allclose(DEVIATION_RATIO * ground.deviation.mean(axis=0), [2.0, 5.0, 9.0], rtol=0.1)


def test_thresholds_are_bounded():
    """So many standard deviations, between the smallest and the largest."""
    deviation = np.array([[1.0, 5.0, 50.0]], np.float32)
    assert thresholds_of(deviation, 4.0 / DEVIATION_RATIO, 10.0).tolist() == [[10, 20, 60]]
    assert thresholds_of(deviation, 0.0, 22.0).tolist() == [[22, 22, 22]]
