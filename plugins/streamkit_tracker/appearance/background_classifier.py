"""A linear classifier between the mean appearance of one target and patches of its background."""

from __future__ import annotations

import numpy as np

from streamkit_kernels import product
from streamkit_tracker.window_geometry import Float32Array

APPEARANCE_RATE = 0.1  # of the mean appearance, at least
KEPT_PATCHES = 512
RIDGE = 0.3  # of the mean variance of the background
ITERATIONS = 8  # from the last solution
SOLVED = 1e-12  # squared length of what is left to solve


class BackgroundClassifier:
    """Scores patches: 1 for the mean appearance of the target, 0 for the mean of the background.

    The direction between both means, divided by the covariance of the background, so that what the background
    has, too, counts little.

    Source: Hariharan, Malik and Ramanan, Discriminative Decorrelation for Clustering and Classification,
    ECCV 2012.

    Args:
        appearance: float32[k], of the target in the first frame.
        background: float32[n, k], patches of the first frame.

    Attributes:
        weights: float32[k]; the score of a patch is its product with them plus `bias`.
    """

    def __init__(self, appearance: Float32Array, background: Float32Array) -> None:
        self._appearance, self._background, self._learnt = appearance, background, 1
        self._solution = np.zeros_like(appearance)
        self.weights, self.bias = self._solution, np.float32(0)
        self._solve()

    def learn(self, appearance: Float32Array, background: Float32Array) -> None:
        """Learns one more appearance float32[k] and patches of the background float32[n, k]."""
        self._learnt += 1
        rate = np.float32(max(APPEARANCE_RATE, 1 / self._learnt))
        self._appearance = self._appearance + rate * (appearance - self._appearance)
        self._background = np.concatenate([self._background, background])[-KEPT_PATCHES:]
        self._solve()

    def _solve(self) -> None:
        """Improves the last solution by conjugate gradients: a covariance need not be formed or inverted."""
        centre = self._background.mean(axis=0)
        deviations, goal = self._background - centre, self._appearance - centre
        ridge = np.float32(RIDGE * np.mean(deviations**2) + 1e-6)

        def spread(direction: Float32Array) -> Float32Array:
            """The regularised covariance of the background times a direction, float32[k]."""
            along = product(deviations, direction[:, None])
            variance = product(along.T, deviations)[0] / np.float32(len(deviations))
            return np.asarray(variance + ridge * direction, np.float32)

        solution = self._solution
        residual = goal - spread(solution)
        direction, power = residual, residual @ residual
        for _ in range(ITERATIONS):
            if power <= SOLVED:
                break
            image = spread(direction)
            step = power / (direction @ image)
            solution, residual = solution + step * direction, residual - step * image
            last, power = power, residual @ residual
            direction = residual + (power / last) * direction
        self._solution = solution
        self.weights = solution / max(solution @ goal, np.float32(1e-6))
        self.bias = -(self.weights @ centre)
