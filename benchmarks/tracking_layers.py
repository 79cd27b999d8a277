"""Layered sampling against flat sampling: the same evaluations, template, motion model and sequences.

    STREAMKIT_DATA=... python benchmarks/tracking_layers.py [--sequences 6] [--first 500] [--frames 100]

Both have 364 evaluations a frame of 32x32 samples (220 + 72 + 72 in layers, or all at once in five
dimensions) and the first patch as their template; nothing else of the tracker takes part. Rendered sequences
with turn, size and light, the camera's motion taken out.
"""

import argparse
import itertools
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from tracking_sequences import KINDS, FloatArray, Step, rendered

from streamkit_tracker.eigen_template import EigenTemplate, eigen_distances
from streamkit_tracker.layered_filter import Cloud, LayerSettings, Proposal, Score, layered_step
from streamkit_tracker.window_geometry import half_turn
from streamkit_tracker.window_sampling import WindowSampler, shrink_factor

PATCH = (32, 32)
SETTINGS = LayerSettings()
EVALUATIONS = SETTINGS.particles + SETTINGS.keep * (SETTINGS.size_particles + SETTINGS.angle_particles)
SIGMA = 0.09
NARROW, WIDE = 2.5, 6.0  # px


@dataclass
class Layered:
    """Position, then size, then angle."""

    cloud: Cloud

    def carry(self, camera: FloatArray) -> None:
        """Moves the particles with the camera, float64[2]."""
        self.cloud.positions = self.cloud.positions + camera

    def step(self, window: FloatArray, motion: FloatArray, score: Score, generator: Generator) -> FloatArray:
        """The window, float64[5], after one frame."""
        proposal = Proposal(
            window[None],
            motion[None, :2],
            np.array([NARROW]),
            np.array([WIDE]),
            np.full((1, 2), np.nan),
            np.zeros(1),
        )
        result = layered_step([self.cloud], [generator], proposal, score, SETTINGS)
        self.cloud = result.clouds[0]
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


def follow(steps: list[Step], *, layered: bool, seed: int) -> tuple[float, float]:
    """Median errors of centre, px, and angle, degrees."""
    sampler, generator = WindowSampler(), np.random.default_rng(seed)
    sampler.look_at(cv2.cvtColor(steps[0].picture, cv2.COLOR_BGR2GRAY))
    assert steps[0].window is not None
    window, motion = steps[0].window.copy(), np.zeros(5)
    factor = shrink_factor(window, PATCH, sampler.shape)
    template = EigenTemplate(sampler.sample(window[None], PATCH, factor)[0].copy())
    method: Layered | Flat = Layered(Cloud.at(window)) if layered else Flat(window[None].copy())

    def score(windows: FloatArray) -> FloatArray:
        patches = sampler.sample(windows.reshape(-1, 5), PATCH, factor)[None]
        return np.asarray(-0.5 / SIGMA**2 * eigen_distances([template], patches), np.float64)

    errors, turns = [], []
    for step in steps[1:]:
        assert step.window is not None
        sampler.look_at(cv2.cvtColor(step.picture, cv2.COLOR_BGR2GRAY))
        method.carry(-step.to_previous[:2, 2])
        before = window.copy()
        before[:2] -= step.to_previous[:2, 2]
        window = method.step(before, motion, score, generator)
        motion = 0.5 * motion + 0.5 * (window - before)
        errors.append(np.hypot(*(window[:2] - step.window[:2])))
        turns.append(abs(float(half_turn(window[4] - step.window[4]))))
    return float(np.median(errors)), float(np.degrees(np.median(turns)))


def main() -> None:
    """Prints one row for each sequence and the ratio of the means."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sequences", type=int, default=6)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--frames", type=int, default=100)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    print(f"{EVALUATIONS} evaluations a frame; median errors of centre (px) and angle (degrees)")
    print("| sequence | layered | flat |")
    print("|---|---|---|")
    rows = []
    for seed in range(options.first, options.first + options.sequences):
        steps = list(itertools.islice(rendered(KINDS[0], seed), options.frames))
        layered = follow(steps, layered=True, seed=seed)
        flat = follow(steps, layered=False, seed=seed)
        rows.append((layered, flat))
        print(f"| {seed} | {layered[0]:.2f}, {layered[1]:.2f} | {flat[0]:.2f}, {flat[1]:.2f} |", flush=True)
    means = np.mean(rows, axis=0)
    print(
        f"layered / flat: centre {means[0, 0] / means[1, 0]:.2f}, angle {means[0, 1] / means[1, 1]:.2f} "
        "(asked: centre 0.7 or less)"
    )


if __name__ == "__main__":
    main()
