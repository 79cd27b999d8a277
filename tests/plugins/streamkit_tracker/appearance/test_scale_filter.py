"""The filter over sizes."""

from types import ModuleType

import numpy as np
import pytest

from streamkit_tracker.appearance.scale_filter import ScaleFilter, parabola_peak
from streamkit_tracker.appearance.window_sampling import WindowSampler

WINDOW = np.array([150.0, 120, 60, 44, 0.2])


def seen(scenes: ModuleType, grown: float, noise: float = 2.0, seed: int = 4) -> WindowSampler:
    """One textured target at a size, with the noise of a seed."""
    generator = np.random.default_rng(4)
    ground, texture = scenes.ground(generator, 240, 320), scenes.blob_texture(generator)
    picture = scenes.paint(ground, texture, WINDOW * [1, 1, grown, grown, 1])
    sampler = WindowSampler()
    sampler.set_frame(scenes.grey(picture, np.random.default_rng(seed), noise))
    return sampler


@pytest.mark.parametrize("grown", [0.93, 0.97, 1.0, 1.03, 1.08])
def test_a_growth_is_measured(scenes: ModuleType, grown: float):
    """Within a step of 2 per cent."""
    sizes = ScaleFilter(seen(scenes, 1.0), WINDOW)
    assert sizes.growth(seen(scenes, grown), WINDOW) == pytest.approx(grown, rel=0.02)


@pytest.mark.parametrize("rate", [0.985, 1.015])
def test_a_steady_growth_is_followed_in_noise(scenes: ModuleType, rate: float):
    """By a filter that learns its own estimates for 50 frames."""
    window, sizes = WINDOW.copy(), ScaleFilter(seen(scenes, 1.0, 15.0), WINDOW)
    for frame in range(1, 51):
        sampler = seen(scenes, rate**frame, 15.0, seed=frame)
        window[2:4] *= sizes.growth(sampler, window)
        sizes.learn(sampler, window, 1.0)
    assert window[2] == pytest.approx(WINDOW[2] * rate**50, rel=0.05)


def test_a_target_of_few_pixels_has_a_size():
    """8 px wide, on a flat ground: a finite growth near 1."""
    sampler = WindowSampler()
    sampler.set_frame(np.full((60, 80), 90, np.uint8))
    tiny = np.array([40.0, 30, 8, 6, 0])
    assert 0.8 < ScaleFilter(sampler, tiny).growth(sampler, tiny) < 1.2


def test_a_peak_lies_between_its_samples():
    """Where there is no hump it is at the sample."""
    assert parabola_peak(0.5, 0.9, 0.5) == 0.0
    assert 0.0 < parabola_peak(0.5, 0.9, 0.8) < 0.5
    assert parabola_peak(0.5, 0.5, 0.5) == 0.0
