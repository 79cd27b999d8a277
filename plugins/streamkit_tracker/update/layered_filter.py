"""The layered particle filter: position first, then size, then angle, for many targets side by side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from streamkit.settings import setting
from streamkit_tracker.update.expectations import SearchRows
from streamkit_tracker.update.particle_layers import (
    collapse,
    estimate,
    first_windows,
    propose,
    survivors_of,
)
from streamkit_tracker.window_geometry import FloatArray

Score = Callable[[FloatArray], FloatArray]

POLISH = 0.4


@dataclass(frozen=True)
class LayerSettings:
    """How many particles each layer has, and how far they spread."""

    particles: int = setting(
        220, min=1, max=8000, doc="Positions in layer 1, for a target without a detection."
    )
    keep: int = setting(12, min=1, max=200, doc="Positions that go on to layers 2 and 3.")
    size_particles: int = setting(6, min=0, max=50, doc="Sizes tried in layer 2 for each position kept.")
    angle_particles: int = setting(6, min=0, max=50, doc="Angles tried in layer 3 for each position kept.")
    std_size: float = setting(0.02, min=0.0, max=1.0, doc="Relative noise of length and width.")
    std_angle: float = setting(0.03, min=0.0, max=3.2, unit="rad", doc="Noise of the angle.")


@dataclass(eq=False)
class Particles:
    """The particles a target keeps between two frames.

    Attributes:
        positions: float64[k, 2], px.
        weights: float64[k], sum 1.
    """

    positions: FloatArray
    weights: FloatArray

    @classmethod
    def at(cls, position: FloatArray) -> Particles:
        """One particle at float64[2]."""
        return cls(np.array(position[None, :2], np.float64), np.ones(1))


@dataclass(frozen=True, eq=False)
class Estimates:
    """Weighted means over the survivors of one step, for t targets.

    Attributes:
        windows: float64[t, 5], x y length width angle.
        covariances: float64[t, 2, 2] of x and y, px squared.
        contrasts: float64[t], best minus median log score of layer 1; near zero the image said nothing.
        particles: what each target keeps for the next frame.
    """

    windows: FloatArray
    covariances: FloatArray
    contrasts: FloatArray
    particles: list[Particles]


def layered_step(
    particles: list[Particles],
    generators: list[np.random.Generator],
    searches: SearchRows,
    score: Score,
    settings: LayerSettings,
) -> Estimates:
    """Estimates the windows of t independent targets in one frame.

    Layer 1 draws positions from the previous particles moved by the second-order transition; layer 2 draws
    sizes for each survivor; layer 3 angles. Scores of the last layer are handed back from leaf to root:
    every survivor of layer 1 ends with one full state and one weight.

    Args:
        particles: of the previous frame, in the pixels of this one.
        generators: one for each target, the only sources of chance.
        searches: t rows of `SEARCH`.
        score: log scores float64[t, n] of windows float64[t, n, 5].
        settings: how many particles.

    Source: MacCormick and Isard, Partitioned sampling, ECCV 2000; Yang, Duraiswami and Davis, Fast multiple
    object tracking via a hierarchical particle filter, ICCV 2005.
    """
    targets, keep = len(particles), min(settings.keep, settings.particles)
    # normal numbers for each layer of one target
    draws = 2 * settings.particles, 4 * keep * settings.size_particles, 3 * keep * settings.angle_particles
    noise = np.empty((targets, sum(draws)))
    for generator, row in zip(generators, noise, strict=True):
        generator.standard_normal(out=row)
    offsets = np.array([generator.random() for generator in generators])
    # side by side; weight 0 where a target has fewer particles
    most = max(len(held.weights) for held in particles)
    positions, weights = np.zeros((targets, most, 2)), np.zeros((targets, most))
    for target, held in enumerate(particles):
        positions[target, : len(held.weights)] = held.positions
        weights[target, : len(held.weights)] = held.weights
    windows = np.empty((targets, settings.particles, 5))
    first_windows(positions, weights, offsets, searches, noise, windows)
    scores = score(windows)
    order = np.argsort(-scores, axis=1, kind="stable")
    survivors, best = np.empty((targets, keep, 5)), np.empty((targets, keep))
    measures = np.empty((targets, 2))
    survivors_of(windows, scores, order, survivors, best, measures)
    polish = POLISH * np.minimum(searches["spread"], measures[:, 1])
    first = draws[0]
    for copies, used, deviation, turned in (
        (settings.size_particles, draws[1], settings.std_size, False),
        (settings.angle_particles, draws[2], settings.std_angle, True),
    ):
        if copies > 0:
            proposals = np.empty((targets, keep * copies, 5))
            propose(survivors, noise, first, polish, deviation, turned, proposals)
            collapse(survivors, best, proposals, score(proposals))
        first += used
    estimates, covariances, weights = np.empty((targets, 5)), np.empty((targets, 2, 2)), np.empty_like(best)
    estimate(survivors, best, estimates, covariances, weights)
    kept = [Particles(survivors[t, :, :2].copy(), weights[t]) for t in range(targets)]
    return Estimates(estimates, covariances, measures[:, 0], kept)
