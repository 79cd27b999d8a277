"""The layered particle filter: position first, then size, then angle, for many targets side by side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streamkit.settings import setting
from streamkit_tracker.update.expectations import SearchRows
from streamkit_tracker.window_geometry import ANGLE, LENGTH, MINIMUM_SIDE, WIDTH, FloatArray, half_turn

Score = Callable[[FloatArray], FloatArray]

POLISH = 0.4
WIDE_EVERY = 4


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
    draws = [2 * settings.particles, 4 * keep * settings.size_particles, 3 * keep * settings.angle_particles]
    noise = np.array([generator.standard_normal(sum(draws)) for generator in generators])
    offsets = [generator.random() for generator in generators]
    shifts, resizes, turns = np.split(noise, np.cumsum(draws)[:2], axis=1)
    origins = np.empty((targets, settings.particles, 2))
    for target, (held, offset) in enumerate(zip(particles, offsets, strict=True)):
        if len(held.weights) == 1:
            origins[target] = held.positions
        else:
            origins[target] = held.positions[resample(held.weights, offset, settings.particles)]
    windows = _first_windows(origins, searches, shifts.reshape(targets, -1, 2))
    scores = score(windows)
    order = np.argsort(-scores, axis=1, kind="stable")[:, :keep]
    survivors = np.take_along_axis(windows, order[:, :, None], axis=1)
    best = np.take_along_axis(scores, order, axis=1)
    contrasts = best[:, 0] - np.median(scores, axis=1)
    scatter = np.sqrt(survivors[:, :, :2].var(axis=1).mean(axis=1))
    polish = (POLISH * np.minimum(searches["spread"], scatter))[:, None, None]
    if settings.size_particles:
        proposals, steps = _copies(survivors, resizes, settings.size_particles, polish)
        sides = proposals[..., LENGTH : WIDTH + 1]
        sides[:] = np.maximum(sides * np.exp(steps[..., 2:] * settings.std_size), MINIMUM_SIDE)
        _hand_back(survivors, best, proposals, score(proposals))
    if settings.angle_particles:
        proposals, steps = _copies(survivors, turns, settings.angle_particles, polish)
        proposals[..., ANGLE] = half_turn(proposals[..., ANGLE] + steps[..., 2] * settings.std_angle)
        _hand_back(survivors, best, proposals, score(proposals))
    return _estimate(survivors, best, contrasts)


def resample(weights: FloatArray, offset: float, count: int) -> NDArray[np.intp]:
    """Draws `count` indices, each as often as its weight float64[k] says, with one random number in [0, 1).

    Source: Kitagawa, Monte Carlo filter and smoother, 1996.
    """
    edges = weights.cumsum()
    places = (np.arange(count) + offset) * (edges[-1] / count)
    return np.asarray(np.searchsorted(edges[:-1], places, side="right"), np.intp)


def _first_windows(origins: FloatArray, searches: SearchRows, shifts: FloatArray) -> FloatArray:
    """The windows of layer 1, float64[t, n, 5]: particles moved by the transition and its noise.

    The first of each target is the prediction itself. With a seed every second one lies there, the first of
    them exactly.

    Args:
        origins: float64[t, n, 2], drawn from the particles, px.
        searches: t rows of `SEARCH`.
        shifts: float64[t, n, 2], standard normal.
    """
    number = np.arange(origins.shape[1])
    windows = np.repeat(searches["window"][:, None], len(number), axis=1)
    origins[:, 0] = searches["window"][:, :2]
    seeded = ~np.isnan(searches["seed_spread"])[:, None] & (number % 2 == 1)
    spread = np.where(number % WIDE_EVERY == 0, searches["wide_spread"][:, None], searches["spread"][:, None])
    spread = np.where(seeded, searches["seed_spread"][:, None], spread)
    spread[:, :1], spread[:, 1:2] = 0.0, np.where(seeded[:, 1:2], 0.0, spread[:, 1:2])
    centres = origins + searches["displacement"][:, None]
    centres = np.where(seeded[:, :, None], searches["seed"][:, None], centres)
    windows[:, :, :2] = centres + shifts * spread[:, :, None]
    return windows


def _copies(
    survivors: FloatArray, noise: FloatArray, copies: int, polish: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Copies of survivors, float64[t, k * copies, 5], moved by a small step, and their normal numbers."""
    proposals = np.repeat(survivors, copies, axis=1)
    steps = noise.reshape(*proposals.shape[:2], -1)
    proposals[..., :2] += steps[..., :2] * polish
    return proposals, steps


def _hand_back(survivors: FloatArray, best: FloatArray, proposals: FloatArray, scores: FloatArray) -> None:
    """Replaces each survivor and its score by the best of its copies where that is better."""
    targets, keep = best.shape
    families = scores.reshape(targets, keep, -1)
    leader = families.argmax(axis=2)[:, :, None]
    leading = np.take_along_axis(families, leader, axis=2)[..., 0]
    better = leading > best
    windows = np.take_along_axis(proposals.reshape(targets, keep, -1, 5), leader[..., None], axis=2)[:, :, 0]
    survivors[better], best[better] = windows[better], leading[better]


def _estimate(survivors: FloatArray, best: FloatArray, contrasts: FloatArray) -> Estimates:
    """Means of survivors float64[t, k, 5] weighted by their log scores float64[t, k]; angles modulo pi."""
    weights = np.exp(best - best.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    windows = np.einsum("tk,tki->ti", weights, survivors)
    doubled = 2 * survivors[..., ANGLE]
    sine, cosine = (weights * np.sin(doubled)).sum(axis=1), (weights * np.cos(doubled)).sum(axis=1)
    windows[:, ANGLE] = half_turn(0.5 * np.arctan2(sine, cosine))
    apart = survivors[..., :2] - windows[:, None, :2]
    covariances = np.einsum("tk,tki,tkj->tij", weights, apart, apart)
    particles = [Particles(*each) for each in zip(survivors[..., :2].copy(), weights, strict=True)]
    return Estimates(windows, covariances, contrasts, particles)
