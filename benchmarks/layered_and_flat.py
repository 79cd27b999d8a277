"""Layered sampling and a flat filter with the same number of evaluations, template and motion model."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.template_comparison import template_distances
from streamkit_tracker.appearance.window_sampling import WindowSampler, shrink_factor
from streamkit_tracker.update.layered_filter import SEARCH, LayerSettings, Particles, Score, layered_step
from streamkit_tracker.window_geometry import FloatArray, half_turn, unit_grid

PATCH = (32, 32)
SETTINGS = LayerSettings()
EVALUATIONS = SETTINGS.particles + SETTINGS.keep * (SETTINGS.size_particles + SETTINGS.angle_particles)
SIGMA = 0.09
NARROW, WIDE = 2.5, 6.0  # px
GreyStep = tuple[NDArray[np.uint8], FloatArray, FloatArray]


@dataclass
class Layered:
    """Position, then size, then angle."""

    particles: Particles | None = None

    def carry(self, camera: FloatArray) -> None:
        """Moves the particles with the camera, float64[2]."""
        if self.particles is not None:
            self.particles.positions = self.particles.positions + camera

    def step(self, window: FloatArray, motion: FloatArray, score: Score, generator: Generator) -> FloatArray:
        """The window, float64[5], after one frame."""
        searches = np.zeros(1, SEARCH)
        searches["window"], searches["displacement"] = window, motion[:2]
        searches["spread"], searches["wide_spread"], searches["seed_std"] = NARROW, WIDE, np.inf
        result = layered_step([self.particles], [generator], searches, score, SETTINGS)
        self.particles = result.particles[0]
        return np.asarray(result.windows[0])


@dataclass
class Flat:
    """All five numbers at once: noise, score, weighted mean, resample."""

    particles: FloatArray

    def carry(self, camera: FloatArray) -> None:
        """Moves the particles with the camera, float64[2]."""
        self.particles[:, :2] += camera

    def step(self, _window: FloatArray, motion: FloatArray, score: Score, generator: Generator) -> FloatArray:
        """The window, float64[5], after one frame."""
        moved = self.particles[generator.integers(0, len(self.particles), EVALUATIONS)]
        noise = generator.standard_normal((EVALUATIONS, 5))
        spread = np.where(np.arange(EVALUATIONS) % 4 == 0, WIDE, NARROW)[:, None]
        moved[:, :2] += motion[:2] + noise[:, :2] * spread
        moved[:, 2:4] *= np.exp(noise[:, 2:4] * SETTINGS.std_size)
        moved[:, 4] += noise[:, 4] * SETTINGS.std_angle
        scores = score(moved[None])[0]
        weights = np.exp(scores - scores.max())
        weights /= weights.sum()
        self.particles = moved[generator.choice(EVALUATIONS, EVALUATIONS, p=weights)]
        return np.asarray(weights @ moved)


def follow(steps: Iterable[GreyStep], *, layered: bool, seed: int) -> tuple[float, float]:
    """Median errors of centre, px, and angle, degrees, with the first patch as template.

    Args:
        steps: the frame, uint8[h, w]; the true window, float64[5]; and how far the camera moved the picture,
            float64[2] px.
        layered: whether to sample in layers.
        seed: of the particles.
    """
    sampler, generator = WindowSampler(), np.random.default_rng(seed)
    (picture, truth, _), *rest = steps
    sampler.set_frame(picture)
    window, motion = truth.copy(), np.zeros(5)
    factor = shrink_factor(window, PATCH, sampler.shape)
    template = EigenTemplate(sampler.sample(window[None], PATCH, factor)[0].copy())
    method: Layered | Flat = Layered() if layered else Flat(window[None].copy())

    def score(windows: FloatArray) -> FloatArray:
        crops = sampler.crop(windows.reshape(-1, 5), factor)
        rows, constants = template.rows[None], template.constants[None]
        grid = unit_grid(PATCH)
        distances, first = np.empty(windows.shape[:2]), np.empty((1, grid.shape[1]), np.float32)
        windows = np.ascontiguousarray(windows)
        template_distances(crops.quads, crops.parts, factor, windows, grid, rows, constants, distances, first)
        return np.asarray(-0.5 / SIGMA**2 * distances, np.float64)

    errors, turns = [], []
    for picture, truth, camera in rest:
        sampler.set_frame(picture)
        method.carry(camera)
        before = window.copy()
        before[:2] += camera
        window = method.step(before, motion, score, generator)
        motion = 0.5 * motion + 0.5 * (window - before)
        errors.append(np.hypot(*(window[:2] - truth[:2])))
        turns.append(abs(float(half_turn(window[4] - truth[4]))))
    return float(np.median(errors)), float(np.degrees(np.median(turns)))
