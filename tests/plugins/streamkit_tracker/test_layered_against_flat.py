"""Layered sampling against a flat filter with the same number of evaluations and the same template."""

from types import ModuleType

import numpy as np

from streamkit_tracker.eigen_template import EigenTemplate, eigen_distances
from streamkit_tracker.layered_filter import Cloud, LayerSettings, Proposal, layered_step
from streamkit_tracker.window_geometry import half_turn
from streamkit_tracker.window_sampling import WindowSampler

EVALUATIONS = 220 + 72 + 72
PATCH = (32, 32)
SIGMA = 0.09
NARROW, WIDE = 2.5, 6.0


def flat_step(particles: np.ndarray, motion: np.ndarray, score, generator: np.random.Generator):
    """All five numbers at once: noise, score, weighted mean, resample. Float64[n, 5] particles."""
    settings = LayerSettings()
    moved = particles[generator.integers(0, len(particles), EVALUATIONS)]
    noise = generator.standard_normal((EVALUATIONS, 5))
    spread = np.where(np.arange(EVALUATIONS) % 4 == 0, WIDE, NARROW)[:, None]
    moved[:, :2] += motion + noise[:, :2] * spread
    moved[:, 2:4] *= np.exp(noise[:, 2:4] * settings.std_size)
    moved[:, 4] += noise[:, 4] * settings.std_angle
    scores = score(moved[None])[0]
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    return weights @ moved, moved[generator.choice(EVALUATIONS, EVALUATIONS, p=weights)]


def follow(sequence, layered: bool) -> tuple[float, float]:
    """Median errors of centre, px, and angle, degrees, with the first patch as template."""
    sampler, generator = WindowSampler(), np.random.default_rng(3)
    errors, turns = [], []
    template, cloud, particles = None, None, np.zeros((0, 5))
    window = motion = np.zeros(5)

    def score(windows: np.ndarray) -> np.ndarray:
        patches = sampler.sample(windows.reshape(-1, 5), PATCH)[None]
        return np.asarray(-0.5 / SIGMA**2 * eigen_distances([template], patches), np.float64)

    for image, truth in sequence:
        sampler.look_at(image)
        if template is None:
            window, particles, cloud = truth.copy(), truth[None].copy(), Cloud.at(truth)
            template = EigenTemplate(sampler.sample(window[None], PATCH)[0].copy())
            continue
        before = window.copy()
        if layered:
            proposal = Proposal(
                window[None],
                motion[None, :2],
                np.array([NARROW]),
                np.array([WIDE]),
                np.full((1, 2), np.nan),
                np.zeros(1),
            )
            result = layered_step([cloud], [generator], proposal, score, LayerSettings())
            window, cloud = result.windows[0], result.clouds[0]
        else:
            window, particles = flat_step(particles, motion[:2], score, generator)
        motion = 0.5 * motion + 0.5 * (window - before)
        errors.append(np.hypot(*(window[:2] - truth[:2])))
        turns.append(abs(float(half_turn(window[4] - truth[4]))))
    return float(np.median(errors)), float(np.degrees(np.median(turns)))


def test_layers_are_nearer_at_equal_evaluations(scenes: ModuleType):
    """Errors of the layered filter are at most 0.7 of the flat one's, over three sequences."""
    layered = np.mean([follow(scenes.TurningScene(seed=seed, frames=40), True) for seed in (5, 6, 7)], axis=0)
    flat = np.mean([follow(scenes.TurningScene(seed=seed, frames=40), False) for seed in (5, 6, 7)], axis=0)
    assert layered[0] <= 0.7 * flat[0]
    assert layered[1] <= 0.7 * flat[1]
