"""A correlation filter with its weights inside the target, trained on all shifts of the region around it."""

from __future__ import annotations

import copy
import math

import numpy as np
import scipy
from numpy.typing import NDArray

from streamkit_tracker.appearance.region_features import GRID
from streamkit_tracker.window_geometry import Float32Array, FloatArray

ComplexArray = NDArray[np.complex64]

PEAK_WIDTH = 0.1  # standard deviation of the wanted response, relative to the target's mean side
LEARNING_RATE = 0.03
INERTIA, FIRST_INERTIA = 0.3, 1e-3  # relative to the mean power of the first region, as is what follows
WITHIN, OUTSIDE = 1e-4, 10.0
FIRST_ITERATIONS, ITERATIONS = 4, 2
FIRST_PENALTY, PENALTY_STEP, LAST_PENALTY = 0.01, 10.0, 1.0


class BackgroundAwareFilter:
    """Responds to the target and not to the background around it.

    The filter's weights are confined to the target's sides, so that every shift of a region that is much
    larger is a true sample of the background. It is trained on a running mean of the regions, which a cover
    or a step of the target changes slowly, and each solution stays near the one before.

    Source: Galoogahi, Fagg and Lucey, Learning Background-Aware Correlation Filters for Visual Tracking, ICCV
    2017; Li, Tian, Zuo, Zhang and Yang, Learning Spatial-Temporal Regularized Correlation Filters for Visual
    Tracking, CVPR 2018 (the term that keeps successive filters together).

    Args:
        spectra: complex64[channels, grid, grid // 2 + 1] of the first region, the target in its middle.
        extent: float64[2], the target's length and width relative to the region's side.
    """

    def __init__(self, spectra: ComplexArray, extent: FloatArray) -> None:
        power = float(np.mean(np.sum(np.abs(spectra) ** 2, axis=0)))
        self._scaling = np.float32(1 / math.sqrt(max(power, 1e-3)))  # a flat region has none
        cells = np.arange(GRID) - GRID // 2
        width = PEAK_WIDTH * GRID * math.sqrt(extent[0] * extent[1])
        peak = np.exp(-0.5 * (cells[:, None] ** 2 + cells[None] ** 2) / width**2)
        self._wanted = scipy.fft.rfft2(np.fft.ifftshift(peak).astype(np.float32)).conj()
        along, across = (np.abs(cells) <= max(GRID * share / 2, 1.0) for share in extent.tolist())
        self._costs = np.where(across[:, None] & along[None], WITHIN, OUTSIDE).astype(np.float32)
        self._sample = spectra * self._scaling
        self._weights = np.zeros_like(spectra)
        self._solve(FIRST_INERTIA, FIRST_ITERATIONS)

    def respond(self, spectra: ComplexArray) -> Float32Array:
        """Response float32[grid, grid] to a region; no shift is in the middle, cell grid // 2."""
        total = self._scaling * np.sum(self._weights.conj() * spectra, axis=0)
        return np.fft.fftshift(scipy.fft.irfft2(total, s=(GRID, GRID)))

    def mixed(self, earlier: BackgroundAwareFilter, share: float) -> BackgroundAwareFilter:
        """A filter whose response is the mean of both; `share`, 0 to 1, is the weight of the earlier one."""
        other = copy.copy(self)
        other._weights = self._weights + np.float32(share) * (earlier._weights - self._weights)
        return other

    def learn(self, spectra: ComplexArray, share: float) -> None:
        """Learns a region with the target in its middle, as far as `share` says, above 0 to 1."""
        change = spectra * self._scaling - self._sample
        self._sample = self._sample + np.float32(share * LEARNING_RATE) * change
        self._solve(INERTIA, ITERATIONS)

    def _solve(self, inertia: float, iterations: int) -> None:
        """The best filter for the mean region, near the present one.

        By the alternating direction method of multipliers: in turn the best filter of any extent, for each
        frequency by the Sherman-Morrison formula, and the one nearest to it that is confined to the target.
        """
        sample, previous = self._sample, self._weights
        energy, goal = np.sum(np.abs(sample) ** 2, axis=0), sample * self._wanted
        confined, dual, penalty = previous, np.zeros_like(sample), FIRST_PENALTY
        near = np.float32(inertia)
        for _ in range(iterations):
            tie = np.float32(penalty)
            right = goal + near * previous + tie * (confined - dual)
            shared = np.sum(sample.conj() * right, axis=0) / (energy + tie + near)
            free = (right - sample * shared) * (np.float32(1) / (tie + near))
            weights = scipy.fft.irfft2(free + dual, s=(GRID, GRID)) * (tie / (self._costs + tie))
            confined = scipy.fft.rfft2(weights)
            dual += free - confined
            penalty = min(penalty * PENALTY_STEP, LAST_PENALTY)
        self._weights = confined
