"""What the layers of the particle filter do with their particles, for many targets side by side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled
from streamkit_tracker.update.expectations import SearchRows
from streamkit_tracker.window_geometry import ANGLE, LENGTH, MINIMUM_SIDE, WIDTH, FloatArray, half_turn

IndexArray = NDArray[np.intp]

WIDE_EVERY = 4


@compiled
def resample(weights: FloatArray, offset: float, chosen: IndexArray) -> None:
    """Draws indices, each as often as its weight says, with one random number.

    Args:
        weights: float64[k]; a weight of 0 is never drawn.
        offset: uniform in [0, 1).
        chosen: intp[count], is filled, rising.

    Source: Kitagawa, Monte Carlo filter and smoother, 1996.
    """
    edges, count = np.cumsum(weights), len(chosen)
    edges /= edges[-1]
    last = len(edges) - 1
    while last > 0 and weights[last] <= 0:
        last -= 1
    index = 0
    for draw in range(count):
        place = (draw + offset) / count
        while index < last and place >= edges[index]:
            index += 1
        chosen[draw] = index


@compiled
def first_windows(
    positions: FloatArray,
    weights: FloatArray,
    offsets: FloatArray,
    searches: SearchRows,
    noise: FloatArray,
    windows: FloatArray,
) -> None:
    """The windows of layer 1: particles drawn by weight, moved by the transition and its noise.

    Args:
        positions: float64[t, k, 2] of the particles, px.
        weights: float64[t, k]; a weight of 0 is never drawn.
        offsets: float64[t], uniform in [0, 1).
        searches: t rows of `SEARCH`; every second particle lies at a seed, the first exactly.
        noise: float64[t, 2 n or more], standard normal.
        windows: float64[t, n, 5], is filled; the first of each target is the prediction itself.
    """
    chosen = np.empty(windows.shape[1], np.intp)
    for target in range(len(windows)):
        resample(weights[target], offsets[target], chosen)
        at = searches[target]
        known, seed, displacement = at["window"], at["seed"], at["displacement"]
        seeded = not np.isnan(at["seed_spread"])
        for particle in range(windows.shape[1]):
            at_seed = seeded and particle % 2 == 1
            spread = at["wide_spread"] if particle % WIDE_EVERY == 0 else at["spread"]
            if at_seed:
                spread = at["seed_spread"]
            if particle == 0 or (seeded and particle == 1):
                spread = 0.0
            window = windows[target, particle]
            window[:] = known
            for axis in range(2):
                origin = known[axis] if particle == 0 else positions[target, chosen[particle], axis]
                centre = seed[axis] if at_seed else origin + displacement[axis]
                window[axis] = centre + noise[target, 2 * particle + axis] * spread


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
def propose(
    survivors: FloatArray,
    noise: FloatArray,
    first: int,
    polish: FloatArray,
    deviation: float,
    turned: bool,
    proposals: FloatArray,
) -> None:
    """Copies every survivor, each copy with a small step and other sides or another angle.

    Args:
        survivors: float64[t, k, 5].
        noise: float64[t, ...], standard normal; three numbers for each copy that is turned, else four ...
        first: ... from this one on.
        polish: float64[t], standard deviation of the step, px.
        deviation: standard deviation of the change: the logarithm of the sides' factors, or the angle, rad.
        turned: whether the angle changes, else the sides.
        proposals: float64[t, n, 5], is filled, copies of one survivor in a row; n a multiple of k.
    """
    copies = proposals.shape[1] // survivors.shape[1]
    numbers = 3 if turned else 4
    for target in range(len(proposals)):
        for copy in range(proposals.shape[1]):
            parent, window = survivors[target, copy // copies], proposals[target, copy]
            draw = noise[target, first + numbers * copy : first + numbers * copy + numbers]
            for axis in range(2):
                window[axis] = parent[axis] + draw[axis] * polish[target]
            for side in range(LENGTH, WIDTH + 1):
                factor = 1.0 if turned else np.exp(draw[side] * deviation)
                window[side] = max(parent[side] * factor, MINIMUM_SIDE)
            turn = draw[2] * deviation if turned else 0.0
            window[ANGLE] = half_turn(parent[ANGLE] + turn)


@compiled
def collapse(survivors: FloatArray, best: FloatArray, proposals: FloatArray, scores: FloatArray) -> None:
    """Hands the best of each family back to its root, where it is better than that: changes both in place.

    Args:
        survivors: float64[t, k, 5].
        best: float64[t, k], their scores.
        proposals: float64[t, n, 5], see `propose`.
        scores: float64[t, n].
    """
    copies = proposals.shape[1] // survivors.shape[1]
    for target in range(len(proposals)):
        for copy in range(proposals.shape[1]):
            parent = copy // copies
            if scores[target, copy] > best[target, parent]:
                best[target, parent] = scores[target, copy]
                survivors[target, parent] = proposals[target, copy]


@compiled
def estimate(
    survivors: FloatArray,
    best: FloatArray,
    windows: FloatArray,
    covariances: FloatArray,
    weights: FloatArray,
) -> None:
    """Means with weights that sum to 1; the angle modulo pi.

    Args:
        survivors: float64[t, k, 5].
        best: float64[t, k], their log scores.
        windows: float64[t, 5], is filled.
        covariances: float64[t, 2, 2] of x and y, is filled.
        weights: float64[t, k], is filled.
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
        windows[target, ANGLE] = half_turn(0.5 * np.arctan2(sine, cosine))
        covariances[target] = 0.0
        for rank in range(len(share)):
            x = survivors[target, rank, 0] - windows[target, 0]
            y = survivors[target, rank, 1] - windows[target, 1]
            covariances[target, 0, 0] += share[rank] * x * x
            covariances[target, 0, 1] += share[rank] * x * y
            covariances[target, 1, 1] += share[rank] * y * y
        covariances[target, 1, 0] = covariances[target, 0, 1]
        weights[target] = share
