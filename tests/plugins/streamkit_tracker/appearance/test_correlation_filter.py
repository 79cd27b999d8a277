"""The filter that distinguishes a target from the ground around it."""

from types import ModuleType

import numpy as np
import pytest

from streamkit_tracker.appearance.correlation_filter import MIN_SHARPNESS, CorrelationFilter
from streamkit_tracker.appearance.window_sampling import WindowSampler

SIZE = (240, 320)


def seen(scenes: ModuleType, window: np.ndarray | None, light: float = 1.0) -> np.ndarray:
    """One textured ground with one textured target, or without."""
    generator = np.random.default_rng(4)
    backdrop = scenes.ground(generator, *SIZE)
    texture = scenes.blob_texture(generator)
    picture = backdrop if window is None else scenes.paint(backdrop, texture, window)
    return scenes.grey(light * picture, generator, 2.0)


def trained(scenes: ModuleType, window: np.ndarray) -> tuple[WindowSampler, CorrelationFilter]:
    """A filter that has seen the target once."""
    sampler = WindowSampler()
    sampler.set_frame(seen(scenes, window))
    return sampler, CorrelationFilter(sampler, window)


@pytest.mark.parametrize("angle", [0.0, 0.7, -1.2])
@pytest.mark.parametrize("step", [(3.3, -2.6), (17.0, 11.0)])
def test_a_shift_is_found(scenes: ModuleType, angle: float, step: tuple[float, float]):
    """Within a quarter of a cell of 5 px, whatever the turn of the window, up to half of its side."""
    window = np.array([150.0, 120, 48, 34, angle])
    sampler, discriminator = trained(scenes, window)
    moved = window + np.array([*step, 0, 0, 0])
    sampler.set_frame(seen(scenes, moved))
    response = discriminator.respond(sampler, window)
    assert np.hypot(*(response.window[:2] - moved[:2])) < 1.25
    assert response.sharpness > 9


def test_light_does_not_count(scenes: ModuleType):
    """Half the light gives nearly the same response."""
    window = np.array([150.0, 120, 48, 34, 0.3])
    sampler, discriminator = trained(scenes, window)
    bright = discriminator.respond(sampler, window)
    sampler.set_frame(seen(scenes, window, light=0.5))
    dark = discriminator.respond(sampler, window)
    assert dark.peak > 0.7 * bright.peak
    np.testing.assert_allclose(dark.window[:2], window[:2], atol=0.5)


def test_ground_without_the_target_responds_faintly(scenes: ModuleType):
    """A third of what the target gives at most."""
    window = np.array([150.0, 120, 48, 34, 0.0])
    sampler, discriminator = trained(scenes, window)
    there = discriminator.respond(sampler, window)
    sampler.set_frame(seen(scenes, None))
    gone = discriminator.respond(sampler, window)
    assert gone.peak < there.peak / 3


def test_learning_follows_a_new_look(scenes: ModuleType):
    """After some frames of another texture the filter answers to that one better than before."""
    window = np.array([150.0, 120, 48, 34, 0.0])
    sampler, discriminator = trained(scenes, window)
    generator = np.random.default_rng(9)
    other = scenes.paint(scenes.ground(generator, *SIZE), scenes.blob_texture(generator), window)
    sampler.set_frame(scenes.grey(other, generator, 2.0))
    before = discriminator.respond(sampler, window)
    for _ in range(30):
        discriminator.learn(sampler, discriminator.features.read(sampler, window))
    after = discriminator.respond(sampler, window)
    assert after.peak > before.peak + 0.2


def test_a_flat_patch_gives_no_peak():
    """Nothing divides by the contrast of a constant."""
    sampler = WindowSampler()
    sampler.set_frame(np.full((60, 80), 90, np.uint8))
    window = np.array([40.0, 30, 20, 10, 0])
    response = CorrelationFilter(sampler, window).respond(sampler, window)
    assert abs(response.peak) < 1e-4
    assert response.sharpness < MIN_SHARPNESS
