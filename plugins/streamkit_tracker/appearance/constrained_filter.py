"""A filter kept inside the target's own sides and near its predecessor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import compiled
from streamkit_tracker.appearance.grid_spectra import ComplexArray, Cutter

REGULARISATION = 0.001  # weights are relative to the mean power of the first patch
INERTIA = 0.1
OUTSIDE, WITHIN = 10.0, 1e-4
FIRST_ITERATIONS, ITERATIONS = 4, 2
FIRST_PENALTY, PENALTY_STEP, LAST_PENALTY = 0.01, 10.0, 1.0


class ConstrainedFilter:
    """Responds to the target and not to the background it was seen on.

    A plain correlation filter is as large as its patch and learns the background with the target; when
    that changes, its response fades. This one has its coefficients inside the target's sides, and each patch
    moves it only as far from its predecessor as the response needs.

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
        side = spectrum.shape[1]
        self._cut = Cutter(_within(side, scale[1]), _within(side, scale[0]))
        self._filter = np.zeros_like(spectrum)
        self._solve(spectrum, REGULARISATION, FIRST_ITERATIONS)

    def respond(self, spectrum: ComplexArray) -> ComplexArray:
        """Spectrum complex64[rows, columns // 2 + 1] of the response to a patch, given its own."""
        result = np.empty(spectrum.shape[1:], np.complex64)
        _respond(self._filter, spectrum, self._scaling, result)
        return result

    def learn(self, spectrum: ComplexArray, share: float = 1.0) -> None:
        """Learns a patch with the target in its middle, as far as `share` says, above 0 to 1."""
        self._solve(spectrum, INERTIA / share, ITERATIONS)

    def _solve(self, spectrum: ComplexArray, inertia: float, iterations: int) -> None:
        """Finds the best filter for one patch near the present one.

        By the alternating direction method of multipliers: in turn the best filter of any extent, and the
        one nearest to it whose weights outside the target's sides are penalised.
        """
        sample = spectrum * self._scaling
        previous, inside = self._filter, self._filter.copy()
        free, dual, penalty = np.empty_like(sample), np.zeros_like(sample), FIRST_PENALTY
        for _ in range(iterations):
            _solve_unbounded(sample, self._wanted, previous, inside, dual, inertia, penalty, free)
            inside_factor, outside_factor = penalty / (WITHIN + penalty), penalty / (OUTSIDE + penalty)
            _split(free, self._cut(free), inside_factor, outside_factor, inside, dual)
            penalty = min(penalty * PENALTY_STEP, LAST_PENALTY)
        self._filter = inside


@compiled
def _respond(
    weights: ComplexArray, spectrum: ComplexArray, scaling: np.float32, result: ComplexArray
) -> None:
    """Sum over the channels of the filter times a patch; `result` complex64[rows, columns] is filled."""
    frequencies = result.reshape(result.size)
    frequencies[:] = 0
    for channel in range(len(weights)):
        weight, patch = weights[channel].reshape(result.size), spectrum[channel].reshape(result.size)
        for index in range(len(frequencies)):
            frequencies[index] += weight[index] * patch[index]
    for index in range(len(frequencies)):
        frequencies[index] *= scaling


@compiled
def _solve_unbounded(
    sample: ComplexArray,
    wanted: ComplexArray,
    previous: ComplexArray,
    inside: ComplexArray,
    dual: ComplexArray,
    inertia: float,
    penalty: float,
    free: ComplexArray,
) -> None:
    """The best filter of any extent, plus the dual.

    Each frequency is a ridge regression with a single sample, which the Sherman-Morrison formula solves.

    Args:
        sample: complex64[channels, rows, columns], scaled spectrum of the patch.
        wanted: complex64[rows, columns].
        previous: complex64[channels, rows, columns], the filter that the new one stays near.
        inside: the same, the latest filter within the target's sides.
        dual: the same, of the difference between both.
        inertia: weight of `previous`.
        penalty: weight of the difference.
        free: complex64[channels, rows, columns], is filled.
    """
    near, step, weight = np.float32(inertia), np.float32(penalty), np.float32(inertia + penalty)
    frequencies, goal = wanted.size, wanted.reshape(wanted.size)
    energy, shared = np.zeros(frequencies, np.float32), np.zeros(frequencies, np.complex64)
    for channel in range(len(sample)):
        patch, solution = sample[channel].reshape(frequencies), free[channel].reshape(frequencies)
        kept, old = inside[channel].reshape(frequencies), previous[channel].reshape(frequencies)
        apart = dual[channel].reshape(frequencies)
        for index in range(frequencies):
            solution[index] = near * old[index] + step * (kept[index] - apart[index])
        for index in range(frequencies):
            solution[index] += patch[index].conjugate() * goal[index]
        for index in range(frequencies):
            shared[index] += patch[index] * solution[index]
        for index in range(frequencies):
            energy[index] += patch[index].real * patch[index].real + patch[index].imag * patch[index].imag
    for index in range(frequencies):
        shared[index] *= np.float32(1) / (weight + energy[index])
    share = np.float32(1) / weight
    for channel in range(len(sample)):
        patch, solution = sample[channel].reshape(frequencies), free[channel].reshape(frequencies)
        apart = dual[channel].reshape(frequencies)
        for index in range(frequencies):
            rest = solution[index] - patch[index].conjugate() * shared[index]
            solution[index] = share * rest + apart[index]


@compiled
def _split(
    free: ComplexArray,
    cut: ComplexArray,
    inside_factor: float,
    outside_factor: float,
    inside: ComplexArray,
    dual: ComplexArray,
) -> None:
    """Splits the filter of any extent into what is kept, inside the sides and outside, and the dual.

    Inside and outside it is scaled by two factors: all by the one, and the part inside by the rest.

    Args:
        free: complex64[channels, rows, columns].
        cut: the same of the part inside.
        inside_factor: factor inside.
        outside_factor: factor outside.
        inside: complex64[channels, rows, columns], is filled.
        dual: likewise.
    """
    rest, outer = np.float32(inside_factor - outside_factor), np.float32(outside_factor)
    for channel in range(len(free)):
        for row in range(free.shape[1]):
            for column in range(free.shape[2]):
                value = free[channel, row, column]
                kept = rest * cut[channel, row, column] + outer * value
                inside[channel, row, column] = kept
                dual[channel, row, column] = value - kept


def _within(side: int, scale: float) -> NDArray[np.bool_]:
    """bool[side]: which samples lie within the target's side.

    The filter lies mirrored about the patch's middle, which is between two samples.
    """
    return np.asarray(np.abs(np.arange(side) - (side + 1) / 2) * (2 / side) * scale <= 1)
