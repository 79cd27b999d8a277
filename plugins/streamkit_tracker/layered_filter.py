"""The layered particle filter: position first, then size, then angle, for many targets side by side."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streamkit_tracker.window_geometry import (
    ANGLE,
    LENGTH,
    MINIMUM_SIDE,
    WIDTH,
    FloatArray,
    half_turn,
)

Score = Callable[[FloatArray], FloatArray]

WIDE_EVERY = 4
POLISH = 0.4


@dataclass(frozen=True)
class LayerSettings:
    """How many particles each layer has, and how far they spread.

    Attributes:
        particles: positions in layer 1.
        keep: survivors of layer 1.
        size_particles: sizes tried for each survivor in layer 2.
        angle_particles: angles tried for each survivor in layer 3.
        std_size: relative standard deviation of length and width.
        std_angle: standard deviation of the angle, rad.
    """

    particles: int = 220
    keep: int = 12
    size_particles: int = 6
    angle_particles: int = 6
    std_size: float = 0.02
    std_angle: float = 0.03

    @property
    def draws(self) -> tuple[int, int, int]:
        """Normal numbers each layer needs for one target."""
        keep = min(self.keep, self.particles)
        return 2 * self.particles, 4 * keep * self.size_particles, 3 * keep * self.angle_particles


@dataclass(eq=False)
class Cloud:
    """The particles a target keeps between two frames.

    Attributes:
        positions: float64[k, 2], px.
        weights: float64[k], sum 1.
    """

    positions: FloatArray
    weights: FloatArray

    @classmethod
    def at(cls, position: FloatArray) -> Cloud:
        """One particle at float64[2]."""
        return cls(np.array(position[None, :2], np.float64), np.ones(1))


@dataclass(frozen=True, eq=False)
class Proposal:
    """Where layer 1 looks, for t targets.

    Attributes:
        windows: float64[t, 5], the windows of the previous frame in the pixels of this one.
        displacement: float64[t, 2], predicted motion since then, px.
        spread: float64[t], standard deviation of the motion noise, px.
        wide_spread: float64[t], the same for a quarter of the particles, against surprises, px.
        seed: float64[t, 2], where half of the particles look besides, as a detection's centre; NaN without.
        seed_spread: float64[t], standard deviation around it, px.
    """

    windows: FloatArray
    displacement: FloatArray
    spread: FloatArray
    wide_spread: FloatArray
    seed: FloatArray
    seed_spread: FloatArray


@dataclass(frozen=True, eq=False)
class Estimates:
    """Weighted means over the survivors of one step, for t targets.

    Attributes:
        windows: float64[t, 5], x y length width angle.
        covariances: float64[t, 2, 2] of x and y, px squared.
        effective_sizes: float64[t], 1 / sum of squared weights, 1 to `keep`.
        contrasts: float64[t], best minus median log score of layer 1; near zero the image said nothing.
        clouds: what each target keeps for the next frame.
    """

    windows: FloatArray
    covariances: FloatArray
    effective_sizes: FloatArray
    contrasts: FloatArray
    clouds: list[Cloud]


def layered_step(
    clouds: list[Cloud],
    generators: list[np.random.Generator],
    proposal: Proposal,
    score: Score,
    settings: LayerSettings,
) -> Estimates:
    """Looks at one frame, for t targets that do not know of each other.

    Layer 1 draws positions from the previous particles moved by the second-order transition; layer 2 draws
    sizes for each survivor; layer 3 angles. Scores of the last layer are handed back from leaf to root:
    every survivor of layer 1 ends with one full state and one weight.

    Args:
        clouds: particles of the previous frame, in the pixels of this one.
        generators: one for each target, the only sources of chance.
        proposal: where to look.
        score: log scores float64[t, n] of windows float64[t, n, 5].
        settings: how many particles.

    Source: MacCormick and Isard, Partitioned sampling, ECCV 2000; Yang, Duraiswami and Davis, Fast multiple
    object tracking via a hierarchical particle filter, ICCV 2005.
    """
    draws = settings.draws
    noise = np.stack([generator.standard_normal(sum(draws)) for generator in generators])
    first_noise, size_noise, angle_noise = np.split(noise, np.cumsum(draws)[:-1], axis=1)
    offsets = np.array([generator.random() for generator in generators])
    windows = np.repeat(proposal.windows[:, None], settings.particles, axis=1)
    windows[:, :, :2] = _positions(clouds, proposal, first_noise, offsets)
    scores = score(windows)
    contrasts = scores.max(axis=1) - np.median(scores, axis=1)
    order = np.argsort(-scores, axis=1, kind="stable")[:, : settings.keep]
    target = np.arange(len(clouds))[:, None]
    survivors = windows[target, order]
    best = scores[target, order]
    gathered = np.sqrt(survivors[:, :, :2].var(axis=1).mean(axis=1))
    polish = POLISH * np.minimum(proposal.spread, gathered)
    if settings.size_particles > 0:
        brood, jitter = _brood(survivors, size_noise, settings.size_particles, 4, polish)
        factors = np.exp(jitter[:, :, 2:] * settings.std_size)
        brood[:, :, LENGTH : WIDTH + 1] = np.maximum(brood[:, :, LENGTH : WIDTH + 1] * factors, MINIMUM_SIDE)
        survivors, best = _collapse(survivors, best, brood, score(brood))
    if settings.angle_particles > 0:
        brood, jitter = _brood(survivors, angle_noise, settings.angle_particles, 3, polish)
        brood[:, :, ANGLE] = half_turn(brood[:, :, ANGLE] + jitter[:, :, 2] * settings.std_angle)
        survivors, best = _collapse(survivors, best, brood, score(brood))
    return _estimates(survivors, best, contrasts)


def _positions(clouds: list[Cloud], proposal: Proposal, noise: FloatArray, offsets: FloatArray) -> FloatArray:
    """Layer 1: float64[t, n, 2]; the first is the prediction itself, the second the seed."""
    targets, count = len(clouds), noise.shape[1] // 2
    most = max(len(cloud.weights) for cloud in clouds)
    positions, weights = np.zeros((targets, most, 2)), np.zeros((targets, most))
    for row, cloud in enumerate(clouds):
        positions[row, : len(cloud.weights)] = cloud.positions
        weights[row, : len(cloud.weights)] = cloud.weights
    chosen = systematic_resample(weights, count, offsets)
    centres = positions[np.arange(targets)[:, None], chosen] + proposal.displacement[:, None]
    spread = np.repeat(proposal.spread[:, None], count, axis=1)
    spread[:, ::WIDE_EVERY] = proposal.wide_spread[:, None]
    seeded = np.isfinite(proposal.seed).all(axis=1)
    centres[seeded, 1::2] = proposal.seed[seeded, None]
    spread[seeded, 1::2] = proposal.seed_spread[seeded, None]
    spread[:, 0] = 0.0
    spread[seeded, 1:2] = 0.0
    centres[:, 0] = proposal.windows[:, :2] + proposal.displacement
    return np.asarray(centres + noise.reshape(targets, count, 2) * spread[:, :, None])


def systematic_resample(weights: FloatArray, count: int, offsets: FloatArray) -> NDArray[np.intp]:
    """Draws `count` indices for each row, each as often as its weight says, with one random number a row.

    Args:
        weights: float64[t, k], rows of sum 1; a weight of 0 is never drawn.
        count: how many to draw.
        offsets: float64[t], uniform in [0, 1).

    Returns:
        intp[t, count], rising along each row.

    Source: Kitagawa, Monte Carlo filter and smoother, 1996.
    """
    edges = np.cumsum(weights, axis=1)
    edges /= edges[:, -1:]
    places = (np.arange(count)[None] + offsets[:, None]) / count
    last = weights.shape[1] - 1 - np.argmax(weights[:, ::-1] > 0, axis=1)
    chosen = (places[:, :, None] >= edges[:, None, :]).sum(axis=2)
    return np.asarray(np.minimum(chosen, last[:, None]), np.intp)


def _brood(
    survivors: FloatArray, noise: FloatArray, children: int, numbers: int, polish: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Copies of every survivor, moved a little, and the normal numbers [t, n, numbers] that moved them."""
    brood = np.repeat(survivors, children, axis=1)
    jitter = noise.reshape(len(survivors), brood.shape[1], numbers)
    brood[:, :, :2] += jitter[:, :, :2] * polish[:, None, None]
    return brood, jitter


def _collapse(
    survivors: FloatArray, best: FloatArray, brood: FloatArray, scores: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Hands the best of each family back to its root."""
    targets, keep = best.shape
    families = scores.reshape(targets, keep, -1)
    target, parent, winner = np.arange(targets)[:, None], np.arange(keep), families.argmax(axis=2)
    leading = families[target, parent, winner]
    heirs = brood.reshape(targets, keep, -1, brood.shape[2])[target, parent, winner]
    better = leading > best
    return np.where(better[:, :, None], heirs, survivors), np.where(better, leading, best)


def _estimates(survivors: FloatArray, best: FloatArray, contrasts: FloatArray) -> Estimates:
    """Means with weights that sum to 1; the angle modulo pi."""
    weights = np.exp(best - best.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    windows = np.einsum("tk,tkc->tc", weights, survivors)
    doubled = 2 * survivors[:, :, ANGLE]
    sine, cosine = np.sum(weights * np.sin(doubled), axis=1), np.sum(weights * np.cos(doubled), axis=1)
    windows[:, ANGLE] = half_turn(0.5 * np.arctan2(sine, cosine))
    offsets = survivors[:, :, :2] - windows[:, None, :2]
    covariances = np.einsum("tk,tki,tkj->tij", weights, offsets, offsets)
    clouds = [Cloud(survivors[t, :, :2].copy(), weights[t]) for t in range(len(weights))]
    return Estimates(windows, covariances, 1.0 / np.sum(weights**2, axis=1), contrasts, clouds)
