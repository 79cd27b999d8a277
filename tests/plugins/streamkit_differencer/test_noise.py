"""Noise of each pixel."""

import numpy as np

from streamkit_differencer.learning import AVERAGED, NONE
from streamkit_differencer.noise import DEVIATION_RATIO, NoiseMap, first_deviation
from streamkit_differencer.noise_learning import PROVISIONAL


def taught(noise, frames, background, updates, rate, valid=255, restless_rate=0.0):
    """Shows frames without foreground to a map."""
    height, width = background.shape
    states = updates, np.zeros_like(background), np.full_like(background, valid)
    for frame in frames:
        noise.learn(frame, background, *states, (0, height, 0, width), rate, restless_rate)


def test_the_deviation_of_noise_is_learnt():
    """After some hundred frames the mean deviation is that of the noise, pixel by pixel, within a tenth."""
    random = np.random.default_rng(0)
    deviation = np.repeat([[2.0, 5.0, 9.0]], 400, axis=0)
    noise, background = NoiseMap((400, 3)), np.full((400, 3), 120, np.uint8)
    noise.set_limits(9.0, 60.0)
    frames = np.clip(np.round(random.normal(120.0, deviation, (300, 400, 3))), 0, 255).astype(np.uint8)
    taught(noise, frames, background, np.full((400, 3), AVERAGED, np.uint8), 0.02)
    np.testing.assert_allclose(DEVIATION_RATIO * noise.deviation.mean(axis=0), [2.0, 5.0, 9.0], rtol=0.1)


def test_pixels_that_do_not_learn_slowly_teach_nothing():
    """And a mover that was missed teaches at most what it is allowed to."""
    noise, updates = NoiseMap((1, 2)), np.array([[AVERAGED, NONE]], np.uint8)
    noise.set_limits(0.0, 12.0)
    noise.deviation[:] = 4.0
    taught(noise, [np.full((1, 2), 255, np.uint8)], np.zeros((1, 2), np.uint8), updates, 0.5)
    np.testing.assert_allclose(noise.deviation, [[8.0, 4.0]])


def test_ground_that_was_never_quiet_teaches_its_noise_at_a_rate_of_its_own():
    """Water is averaged nowhere, and its noise counts; a rate of 0 leaves it out."""
    for restless_rate, expected in ((0.25, 5.0), (0.0, 4.0)):
        noise, nothing = NoiseMap((1, 1)), np.zeros((1, 1), np.uint8)
        noise.set_limits(4.0, 12.0)
        noise.deviation[:] = 4.0
        taught(noise, [np.full((1, 1), 8, np.uint8)], nothing, nothing, 0.5, PROVISIONAL, restless_rate)
        np.testing.assert_allclose(noise.deviation, expected)


def test_thresholds_are_bounded():
    """So many deviations, between the smallest and the largest."""
    noise = NoiseMap((1, 3))
    noise.deviation[:] = np.array([[1.0, 5.0, 50.0]]) / DEVIATION_RATIO
    noise.set_limits(4.0, 10.0)
    assert noise.thresholds.tolist() == [[10, 20, 60]]


def test_two_frames_tell_the_noise_of_a_single_one():
    """The mean difference of two frames with noise where least moves: a little less."""
    random = np.random.default_rng(4)
    first, second = (random.normal(120, 4.0, (400, 600)).round().astype(np.uint8) for _ in range(2))
    second[:300] = 250
    assert abs(first_deviation(first, second) - 4.0 * 2 / np.sqrt(np.pi)) < 0.7
    assert first_deviation(first, first) > 0
