"""Noise of each pixel."""

import numpy as np

from streamkit_differencer.canvas_images import CanvasFrame
from streamkit_differencer.learning import AVERAGED, NONE, PROVISIONAL
from streamkit_differencer.noise import DEVIATION_RATIO, first_deviation
from streamkit_differencer.noise_learning import learn_noise, set_thresholds


def taught(deviation, lowest, frames, background, updates, rate, valid=255, restless_rate=0.0):
    """The deviation after frames without foreground, with the same threshold everywhere."""
    height, width = background.shape
    learnt, thresholds = deviation.astype(np.float32), np.full_like(background, lowest)
    states = updates, np.zeros_like(background), np.full_like(background, valid)
    limits = 0.0, lowest, 60
    for frame in frames:
        images = frame, background, *states, learnt, thresholds
        learn_noise(*images, (0, height, 0, width), rate, restless_rate, *limits)
    return learnt


def test_the_deviation_of_noise_is_learnt():
    """After some hundred frames the mean deviation is that of the noise, pixel by pixel, within a tenth."""
    random = np.random.default_rng(0)
    deviation = np.repeat([[2.0, 5.0, 9.0]], 400, axis=0)
    background, updates = np.full((400, 3), 120, np.uint8), np.full((400, 3), AVERAGED, np.uint8)
    frames = np.clip(np.round(random.normal(120.0, deviation, (300, 400, 3))), 0, 255).astype(np.uint8)
    learnt = taught(np.full((400, 3), 5.0), 60, frames, background, updates, 0.02)
    np.testing.assert_allclose(DEVIATION_RATIO * learnt.mean(axis=0), [2.0, 5.0, 9.0], rtol=0.1)


def test_pixels_that_do_not_learn_slowly_teach_nothing():
    """And a mover that was missed teaches at most what it is allowed to."""
    updates = np.array([[AVERAGED, NONE]], np.uint8)
    frames = [np.full((1, 2), 255, np.uint8)]
    learnt = taught(np.full((1, 2), 4.0), 12, frames, np.zeros((1, 2), np.uint8), updates, 0.5)
    np.testing.assert_allclose(learnt, [[8.0, 4.0]])


def test_ground_that_was_never_quiet_teaches_its_noise_at_a_rate_of_its_own():
    """Water is averaged nowhere, and its noise counts; a rate of 0 leaves it out."""
    nothing, frames = np.zeros((1, 1), np.uint8), [np.full((1, 1), 8, np.uint8)]
    for restless_rate, expected in ((0.25, 5.0), (0.0, 4.0)):
        rates = 0.5, PROVISIONAL, restless_rate
        learnt = taught(np.full((1, 1), 4.0), 12, frames, nothing, nothing, *rates)
        np.testing.assert_allclose(learnt, expected)


def test_thresholds_are_bounded():
    """So many deviations, between the smallest and the largest."""
    deviation, thresholds = np.array([[1.0, 5.0, 50.0]], np.float32), np.zeros((1, 3), np.uint8)
    set_thresholds(deviation, thresholds, (0, 1, 0, 3), 4.0, 10, 60)
    assert thresholds.tolist() == [[10, 20, 60]]


def test_two_frames_tell_the_noise_of_a_single_one():
    """The mean difference of two frames with noise where least moves: a little less."""
    random = np.random.default_rng(4)
    first, second = (random.normal(120, 4.0, (400, 600)).round().astype(np.uint8) for _ in range(2))
    second[:300] = 250
    before, after = (CanvasFrame(image, np.full_like(image, 255)) for image in (first, second))
    region = 0, 400, 0, 600
    assert abs(first_deviation(before, after, region) - 4.0 * 2 / np.sqrt(np.pi)) < 0.7
    assert first_deviation(before, before, region) > 0
