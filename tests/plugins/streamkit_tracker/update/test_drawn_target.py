"""What follows one target drawn by hand."""

from types import ModuleType

import numpy as np

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.update.drawn_target import DrawnTarget

DRAWN = np.array([150.0, 120, 40, 34, 0.0])


def test_a_cover_is_answered_less_than_by_the_latest_filter(scenes: ModuleType):
    """The oldest copy, which has not learnt the cover, has its part in the response."""
    generator, sampler = np.random.default_rng(4), WindowSampler()
    ground = scenes.ground(generator, 240, 320)
    shown, covered = (scenes.paint(ground, scenes.blob_texture(generator), DRAWN) for _ in range(2))
    sampler.set_frame(scenes.grey(shown, generator, 2.0))
    drawn, latest = DrawnTarget(sampler, DRAWN), CorrelationFilter(sampler, DRAWN)
    for _ in range(12):
        sampler.set_frame(scenes.grey(covered, generator, 2.0))
        drawn.learn(sampler, DRAWN, 1.0)
        latest.learn(sampler, latest.features.read(sampler, DRAWN))
    steady, changed = (each.respond(sampler, DRAWN).peak for each in (drawn.filter, latest))
    assert 0 < steady < 0.95 * changed
