"""A filter kept inside the target's own sides and near its predecessor."""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
ComplexArray = NDArray[np.complex64]

REGULARISATION = 0.001  # weights are relative to the mean power of the first patch
INERTIA = 0.1
OUTSIDE, WITHIN = 10.0, 1e-4
FIRST_ITERATIONS, ITERATIONS = 4, 2
FIRST_PENALTY, PENALTY_STEP, LAST_PENALTY = 0.01, 10.0, 1.0


class ConstrainedFilter:
    """Answers to the target and not to the ground it was seen on.

    A plain correlation filter is as large as its patch and learns the ground with the target; when the
    ground changes, its answer fades. This one has its coefficients inside the target's sides, and each patch
    moves it only as far from its predecessor as the answer needs.

    Source: Li, Tian, Zuo, Zhang and Yang, Learning Spatial-Temporal Regularized Correlation Filters for
    Visual Tracking, CVPR 2018.

    Args:
        spectrum: complex64[channels, rows, columns // 2 + 1] of the first patch, the target in its middle.
        wanted: complex64[rows, columns // 2 + 1], spectrum of the response it is to give.
        scale: sides of the patch along and across, relative to the target's.
    """

    def __init__(self, spectrum: ComplexArray, wanted: ComplexArray, scale: tuple[float, float]) -> None:
        power = float(np.sum(np.abs(spectrum) ** 2)) / spectrum[0].size
        self._scaling = np.float32(1 / np.sqrt(max(power, 1e-3)))  # a flat patch has none
        self._wanted = wanted
        self._size = (spectrum.shape[1], spectrum.shape[1])
        self._weight = _outside(self._size[0], scale)
        self._filter = np.zeros_like(spectrum)
        self._solve(spectrum, REGULARISATION, FIRST_ITERATIONS)

    @property
    def transfer(self) -> ComplexArray:
        """complex64[channels, rows, columns // 2 + 1]: times a patch's spectrum it gives the response's."""
        return np.asarray(self._filter * self._scaling, np.complex64)

    def learn(self, spectrum: ComplexArray) -> None:
        """Learns a patch with the target in its middle."""
        self._solve(spectrum, INERTIA, ITERATIONS)

    def _solve(self, spectrum: ComplexArray, inertia: float, iterations: int) -> None:
        """Finds the best filter for one patch near the present one.

        By the alternating direction method of multipliers; each frequency is a ridge regression with a
        single sample, which the Sherman-Morrison formula solves.
        """
        sample = spectrum * self._scaling
        adjoint = np.conj(sample)
        energy = np.sum(np.abs(sample) ** 2, axis=0)
        wish = adjoint * self._wanted + np.float32(inertia) * self._filter
        inside, dual, penalty = self._filter, np.zeros_like(sample), FIRST_PENALTY
        for _ in range(iterations):
            weight = np.float32(inertia + penalty)
            target = wish + np.float32(penalty) * (inside - dual)
            shared = np.sum(sample * target, axis=0) / (weight + energy)
            free = (target - adjoint * shared) / weight + dual
            space = scipy.fft.irfft2(free, s=self._size, axes=(1, 2))
            space *= np.float32(penalty) / (self._weight + np.float32(penalty))
            inside = np.asarray(scipy.fft.rfft2(space, axes=(1, 2)), np.complex64)
            dual = free - inside
            penalty = min(penalty * PENALTY_STEP, LAST_PENALTY)
        self._filter = inside


def _outside(side: int, scale: tuple[float, float]) -> Float32Array:
    """float32[side, side]: a high weight beyond the target's sides, nearly 0 within.

    The filter lies mirrored about the patch's middle, which is between two samples.
    """
    shifts = np.abs(np.arange(side) - (side + 1) / 2) * (2 / side)
    beyond = np.maximum(shifts[None] * scale[0], shifts[:, None] * scale[1]) > 1
    return np.where(beyond, np.float32(OUTSIDE), np.float32(WITHIN))
