"""What the layers of the particle filter do with their particles, for many targets side by side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import ANGLE, LENGTH, MINIMUM_SIDE, WIDTH, FloatArray

IndexArray = NDArray[np.intp]

WIDE_EVERY = 4


@compiled
def resample(weights: FloatArray, offsets: FloatArray, chosen: IndexArray) -> None:
    """Draws indices for each row, each as often as its weight says, with one random number a row.

    Args:
        weights: float64[t, k]; a weight of 0 is never drawn.
        offsets: float64[t], uniform in [0, 1).
        chosen: intp[t, count], is filled, rising along each row.

    Source: Kitagawa, Monte Carlo filter and smoother, 1996.
    """
    count = chosen.shape[1]
    for target in range(len(weights)):
        edges = np.cumsum(weights[target])
        edges /= edges[-1]
        last = len(edges) - 1
        while last > 0 and weights[target, last] <= 0:
            last -= 1
        index = 0
        for draw in range(count):
            place = (draw + offsets[target]) / count
            while index < last and place >= edges[index]:
                index += 1
            chosen[target, draw] = index


@compiled
def scatter(
    centres: FloatArray, noise: FloatArray, spreads: FloatArray, seeds: FloatArray, windows: FloatArray
) -> None:
    """Moves the windows of layer 1 to positions around their centres.

    Args:
        centres: float64[t, n, 2], the first of each target the prediction itself, px.
        noise: float64[t, n, 2], standard normal.
        spreads: float64[t, 3], standard deviations, px: usual, of every fourth particle, and at the seed.
        seeds: float64[t, 2], where every second particle lies instead, the first exactly; NaN without.
        windows: float64[t, n, 5], are moved.
    """
    for target in range(len(windows)):
        usual, wide, near_seed = spreads[target]
        seeded = np.isfinite(seeds[target, 0]) and np.isfinite(seeds[target, 1])
        for particle in range(windows.shape[1]):
            at_seed = seeded and particle % 2 == 1
            spread = near_seed if at_seed else wide if particle % WIDE_EVERY == 0 else usual
            if particle == 0 or (seeded and particle == 1):
                spread = 0.0
            for axis in range(2):
                centre = seeds[target, axis] if at_seed else centres[target, particle, axis]
                windows[target, particle, axis] = centre + noise[target, particle, axis] * spread


@compiled
def survivors_of(
    windows: FloatArray,
    scores: FloatArray,
    order: IndexArray,
    survivors: FloatArray,
    best: FloatArray,
    measures: FloatArray,
) -> None:
    """Keeps the best of layer 1.

    Args:
        windows: float64[t, n, 5].
        scores: float64[t, n].
        order: intp[t, n], by falling score.
        survivors: float64[t, k, 5], is filled.
        best: float64[t, k], their scores, is filled.
        measures: float64[t, 2], is filled: best minus median score, and how far the survivors lie apart, px.
    """
    count, keep = windows.shape[1], best.shape[1]
    for target in range(len(windows)):
        for rank in range(keep):
            survivors[target, rank] = windows[target, order[target, rank]]
            best[target, rank] = scores[target, order[target, rank]]
        middle = scores[target, order[target, count // 2]] + scores[target, order[target, (count - 1) // 2]]
        measures[target, 0] = best[target, 0] - 0.5 * middle
        variance = 0.0
        for axis in range(2):
            mean = survivors[target, :, axis].mean()
            variance += np.sum((survivors[target, :, axis] - mean) ** 2) / keep
        measures[target, 1] = np.sqrt(0.5 * variance)


@compiled
def brood_of(survivors: FloatArray, steps: FloatArray, brood: FloatArray) -> None:
    """Copies of every survivor, each with a step of its own.

    Args:
        survivors: float64[t, k, 5].
        steps: float64[t, n, 5], n a multiple of k: added to x, y and angle; the logarithm of what the sides
            are multiplied by.
        brood: float64[t, n, 5], is filled, family after family.
    """
    children = brood.shape[1] // survivors.shape[1]
    for target in range(len(brood)):
        for child in range(brood.shape[1]):
            parent, step = survivors[target, child // children], steps[target, child]
            window = brood[target, child]
            window[0], window[1] = parent[0] + step[0], parent[1] + step[1]
            for side in range(LENGTH, WIDTH + 1):
                window[side] = max(parent[side] * np.exp(step[side]), MINIMUM_SIDE)
            window[ANGLE] = _half_turn(parent[ANGLE] + step[ANGLE])


@compiled
def collapse(survivors: FloatArray, best: FloatArray, brood: FloatArray, scores: FloatArray) -> None:
    """Hands the best of each family back to its root, where it is better than that: changes both in place.

    Args:
        survivors: float64[t, k, 5].
        best: float64[t, k], their scores.
        brood: float64[t, n, 5], see `brood_of`.
        scores: float64[t, n].
    """
    children = brood.shape[1] // survivors.shape[1]
    for target in range(len(brood)):
        for child in range(brood.shape[1]):
            parent = child // children
            if scores[target, child] > best[target, parent]:
                best[target, parent] = scores[target, child]
                survivors[target, parent] = brood[target, child]


@compiled
def estimate(
    survivors: FloatArray,
    best: FloatArray,
    windows: FloatArray,
    covariances: FloatArray,
    weights: FloatArray,
    sizes: FloatArray,
) -> None:
    """Means with weights that sum to 1; the angle modulo pi.

    Args:
        survivors: float64[t, k, 5].
        best: float64[t, k], their log scores.
        windows: float64[t, 5], is filled.
        covariances: float64[t, 2, 2] of x and y, is filled.
        weights: float64[t, k], is filled.
        sizes: float64[t], 1 / sum of squared weights, is filled.
    """
    for target in range(len(survivors)):
        share = np.exp(best[target] - best[target].max())
        share /= share.sum()
        sine, cosine = 0.0, 0.0
        windows[target] = 0.0
        for rank in range(len(share)):
            particle = survivors[target, rank]
            windows[target] += share[rank] * particle
            sine += share[rank] * np.sin(2 * particle[ANGLE])
            cosine += share[rank] * np.cos(2 * particle[ANGLE])
        windows[target, ANGLE] = _half_turn(0.5 * np.arctan2(sine, cosine))
        covariances[target] = 0.0
        for rank in range(len(share)):
            x = survivors[target, rank, 0] - windows[target, 0]
            y = survivors[target, rank, 1] - windows[target, 1]
            covariances[target, 0, 0] += share[rank] * x * x
            covariances[target, 0, 1] += share[rank] * x * y
            covariances[target, 1, 1] += share[rank] * y * y
        covariances[target, 1, 0] = covariances[target, 0, 1]
        weights[target] = share
        sizes[target] = 1.0 / np.sum(share**2)


@compiled
def _half_turn(angle: float) -> float:
    """Wraps the angle of a direction without sign into [-pi/2, pi/2)."""
    return (angle + np.pi / 2) % np.pi - np.pi / 2
