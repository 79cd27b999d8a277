"""The layered particle filter: position first, then size, then angle, for many targets side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streamkit.settings import setting
from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import ANGLE, LENGTH, MINIMUM_SIDE, WIDTH, FloatArray, half_turn

Score = Callable[[FloatArray], FloatArray]
SearchRows = NDArray[Any]

POLISH = 0.4
WIDE_EVERY = 4
MIN_PARTICLES = 8

# Expectations of one target before the frame is searched; infinite deviations and zero precisions are none.
SEARCH = np.dtype(
    [
        ("window", np.float64, 5),  # of the previous frame in the pixels of this one
        ("displacement", np.float64, 2),  # predicted motion since then, px
        ("spread", np.float64),  # standard deviation of the prediction, px
        ("wide_spread", np.float64),  # the same for a quarter of the particles, against surprises, px
        ("seed", np.float64, 2),  # x y of half of the particles, where the target was detected, px
        ("seed_std", np.float64),  # of the detection, px; infinite without one
        ("seed_spread", np.float64),  # of the particles there, px
        ("sides", np.float64, 2),  # length and width, px
        ("heading", np.float64),  # rad
        ("sides_precision", np.float64),
        ("heading_precision", np.float64),
        ("tolerance", np.float64),  # factor on the variance of the residual
    ]
)


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

    def reduced(self, share: float) -> LayerSettings:
        """A share of the particles, above 0 to 1, but always some."""
        return replace(
            self,
            particles=max(int(self.particles * share), MIN_PARTICLES),
            size_particles=math.ceil(self.size_particles * share),
            angle_particles=math.ceil(self.angle_particles * share),
        )


@dataclass(eq=False)
class Particles:
    """The particles a target keeps between two frames.

    Attributes:
        positions: float64[k, 2], px.
        weights: float64[k], sum 1.
    """

    positions: FloatArray
    weights: FloatArray


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
    particles: Sequence[Particles | None],
    generators: Sequence[np.random.Generator],
    searches: SearchRows,
    score: Score,
    settings: LayerSettings,
) -> Estimates:
    """Estimates the windows of t independent targets in one frame.

    Layer 1 draws positions from the previous particles moved by the second-order transition; layer 2 draws
    sizes for each survivor; layer 3 angles. Scores of the last layer are handed back from leaf to root:
    every survivor of layer 1 ends with one full state and one weight.

    Args:
        particles: of the previous frame, in the pixels of this one; None for one at the target's window.
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
    noise = np.empty((targets, sum(draws)))
    for generator, row in zip(generators, noise, strict=True):
        generator.standard_normal(out=row)
    offsets = np.array([generator.random() for generator in generators])
    windows = np.empty((targets, settings.particles, 5))
    last_windows = searches["window"][:, None, :2]
    held = [each or Particles(at, np.ones(1)) for each, at in zip(particles, last_windows, strict=True)]
    counts = np.array([len(each.weights) for each in held])
    positions = np.concatenate([each.positions for each in held])
    weights = np.concatenate([each.weights for each in held])
    first_windows(positions, weights, counts, offsets, searches, noise, windows)
    scores = score(windows)
    order = np.argsort(-scores, axis=1, kind="stable")
    ranked, last = np.take_along_axis(scores, order, axis=1), scores.shape[1] - 1
    best, survivors = ranked[:, :keep].copy(), np.take_along_axis(windows, order[:, :keep, None], axis=1)
    contrasts = best[:, 0] - (ranked[:, last // 2] + ranked[:, (last + 1) // 2]) / 2  # less the median
    # later layers also step a little, px
    scatter = np.sqrt(survivors[..., :2].var(axis=1).mean(axis=1))
    polish = POLISH * np.minimum(searches["spread"], scatter)
    for copies, turned, deviation in (
        (settings.size_particles, False, settings.std_size),
        (settings.angle_particles, True, settings.std_angle),
    ):
        if copies:
            first = draws[0] + draws[1] * turned
            proposals = np.empty((targets, keep * copies, 5))
            propose(survivors, noise, first, polish, turned, deviation, proposals)
            hand_back(survivors, best, proposals, score(proposals))
    estimates, covariances = np.empty((targets, 5)), np.empty((targets, 2, 2))
    estimate(survivors, best, estimates, covariances)
    kept = [Particles(*each) for each in zip(survivors[..., :2].copy(), best, strict=True)]
    return Estimates(estimates, covariances, contrasts, kept)


@compiled
def resample(weights: FloatArray, offset: float, chosen: NDArray[np.intp]) -> None:
    """Draws indices, intp[n], each as often as its weight float64[k] says, with one random number in [0, 1).

    Source: Kitagawa, Monte Carlo filter and smoother, 1996.
    """
    edges = np.cumsum(weights)
    index, step = 0, edges[-1] / len(chosen)
    for draw in range(len(chosen)):
        while index < len(edges) - 1 and edges[index] <= (draw + offset) * step:
            index += 1
        chosen[draw] = index


@compiled
def first_windows(
    positions: FloatArray,
    weights: FloatArray,
    counts: NDArray[np.intp],
    offsets: FloatArray,
    searches: SearchRows,
    noise: FloatArray,
    windows: FloatArray,
) -> None:
    """The windows of layer 1: particles drawn by weight, moved by the transition and its noise.

    The first of each target is the prediction itself. With a seed every second one lies there, the first of
    them exactly.

    Args:
        positions: float64[k, 2] of the particles of one target after the other, px.
        weights: float64[k].
        counts: intp[t], how many particles each target has.
        offsets: float64[t], in [0, 1), that decide the draws.
        searches: t rows of `SEARCH`.
        noise: float64[t, 2 n or more], standard normal.
        windows: float64[t, n, 5], is filled.
    """
    chosen, begin = np.empty(windows.shape[1], np.intp), 0
    for target in range(len(windows)):
        end, expected = begin + counts[target], searches[target]
        resample(weights[begin:end], offsets[target], chosen)
        seeded = np.isfinite(expected["seed_std"])
        for particle in range(windows.shape[1]):
            at_seed = seeded and particle % 2 == 1
            spread = expected["wide_spread"] if particle % WIDE_EVERY == 0 else expected["spread"]
            if at_seed:
                spread = expected["seed_spread"]
            if particle < 1 + at_seed:
                spread = 0.0
            window = windows[target, particle]
            for column in range(5):
                window[column] = expected["window"][column]
            for axis in range(2):
                if particle > 0:
                    window[axis] = positions[begin + chosen[particle], axis]
                window[axis] += expected["displacement"][axis]
                if at_seed:
                    window[axis] = expected["seed"][axis]
                window[axis] += noise[target, 2 * particle + axis] * spread
        begin = end


@compiled
def propose(
    survivors: FloatArray,
    noise: FloatArray,
    begin: int,
    polish: FloatArray,
    turned: bool,
    deviation: float,
    proposals: FloatArray,
) -> None:
    """Copies every survivor, each copy with a small step and other sides or another angle.

    Args:
        survivors: float64[t, k, 5].
        noise: float64[t, ...], standard normal; three numbers for each copy that is turned, else four ...
        begin: ... from this column on.
        polish: float64[t], standard deviation of the step, px.
        turned: whether the angle changes, else the sides.
        deviation: of the change: the logarithm of the sides' factors, or the angle, rad.
        proposals: float64[t, n, 5], is filled, copies of one survivor in a row; n a multiple of k.
    """
    copies, numbers = proposals.shape[1] // survivors.shape[1], 3 if turned else 4
    for target in range(len(proposals)):
        for copy in range(proposals.shape[1]):
            window, first = proposals[target, copy], begin + numbers * copy
            for column in range(5):
                window[column] = survivors[target, copy // copies, column]
            for axis in range(2):
                window[axis] += noise[target, first + axis] * polish[target]
            if turned:
                window[ANGLE] = half_turn(window[ANGLE] + noise[target, first + 2] * deviation)
            else:
                for side in range(LENGTH, WIDTH + 1):
                    factor = np.exp(noise[target, first + side] * deviation)
                    window[side] = max(window[side] * factor, MINIMUM_SIDE)


@compiled
def hand_back(survivors: FloatArray, best: FloatArray, proposals: FloatArray, scores: FloatArray) -> None:
    """Replaces survivors and their scores by the best of their copies (`propose`), where that is better."""
    copies = proposals.shape[1] // survivors.shape[1]
    for target in range(len(proposals)):
        for copy in range(proposals.shape[1]):
            survivor = copy // copies
            if scores[target, copy] > best[target, survivor]:
                best[target, survivor] = scores[target, copy]
                for column in range(5):
                    survivors[target, survivor, column] = proposals[target, copy, column]


@compiled
def estimate(survivors: FloatArray, best: FloatArray, windows: FloatArray, covariances: FloatArray) -> None:
    """Weighted means, with angles modulo pi.

    Args:
        survivors: float64[t, k, 5].
        best: float64[t, k], their log scores; are turned into weights with the sum 1.
        windows: float64[t, 5], is filled.
        covariances: float64[t, 2, 2] of x and y, is filled.
    """
    for target in range(len(survivors)):
        weights, mean = best[target], windows[target]
        highest, total = -np.inf, 0.0
        for rank in range(len(weights)):
            highest = max(highest, weights[rank])
        for rank in range(len(weights)):
            weights[rank] = np.exp(weights[rank] - highest)
            total += weights[rank]
        for rank in range(len(weights)):
            weights[rank] /= total
        mean[:], sine, cosine = 0.0, 0.0, 0.0
        for rank in range(len(weights)):
            for column in range(ANGLE):
                mean[column] += weights[rank] * survivors[target, rank, column]
            doubled = 2 * survivors[target, rank, ANGLE]
            sine, cosine = sine + weights[rank] * np.sin(doubled), cosine + weights[rank] * np.cos(doubled)
        mean[ANGLE] = half_turn(0.5 * np.arctan2(sine, cosine))
        covariances[target] = 0.0
        for rank in range(len(weights)):
            apart = survivors[target, rank, 0] - mean[0], survivors[target, rank, 1] - mean[1]
            for row in range(2):
                for column in range(2):
                    covariances[target, row, column] += weights[rank] * apart[row] * apart[column]
