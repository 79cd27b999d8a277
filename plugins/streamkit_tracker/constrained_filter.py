"""A filter kept inside the target's own sides and near its predecessor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from streamkit_tracker.compiled import compiled
from streamkit_tracker.grid_spectra import ComplexArray, Cutter

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
        side = spectrum.shape[1]
        self._cut = Cutter(_within(side, scale[1]), _within(side, scale[0]))
        self._filter = np.zeros_like(spectrum)
        self._solve(spectrum, REGULARISATION, FIRST_ITERATIONS)

    def answer(self, spectrum: ComplexArray) -> ComplexArray:
        """Spectrum complex64[rows, columns // 2 + 1] of the response to a patch, given its own."""
        return np.asarray((self._filter * spectrum).sum(axis=0) * self._scaling)

    def learn(self, spectrum: ComplexArray) -> None:
        """Learns a patch with the target in its middle."""
        self._solve(spectrum, INERTIA, ITERATIONS)

    def _solve(self, spectrum: ComplexArray, inertia: float, iterations: int) -> None:
        """Finds the best filter for one patch near the present one.

        By the alternating direction method of multipliers: in turn the best filter of any extent, and the
        one nearest to it whose weights outside the target's sides are dear.
        """
        sample = spectrum * self._scaling
        previous, free = self._filter, np.empty_like(sample)
        inside, dual, penalty = previous, np.zeros_like(sample), FIRST_PENALTY
        for _ in range(iterations):
            _unbounded(sample, self._wanted, previous, inside, dual, inertia, penalty, free)
            # all is scaled by the one factor, and the rectangle by as much more as the other is larger
            dear, cheap = penalty / (OUTSIDE + penalty), penalty / (WITHIN + penalty)
            inside = np.float32(cheap - dear) * self._cut(free) + np.float32(dear) * free
            dual = free - inside
            penalty = min(penalty * PENALTY_STEP, LAST_PENALTY)
        self._filter = inside


@compiled
def _unbounded(
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
    channels, rows, columns = sample.shape
    near, step, weight = np.float32(inertia), np.float32(penalty), np.float32(inertia + penalty)
    for row in range(rows):
        for column in range(columns):
            energy, shared = np.float32(0), np.complex64(0)
            for channel in range(channels):
                value = sample[channel, row, column]
                wish = value.conjugate() * wanted[row, column] + near * previous[channel, row, column]
                wish += step * (inside[channel, row, column] - dual[channel, row, column])
                free[channel, row, column] = wish
                shared += value * wish
                energy += value.real * value.real + value.imag * value.imag
            shared /= weight + energy
            for channel in range(channels):
                value = sample[channel, row, column]
                best = (free[channel, row, column] - value.conjugate() * shared) / weight
                free[channel, row, column] = best + dual[channel, row, column]


def _within(side: int, scale: float) -> NDArray[np.bool_]:
    """bool[side]: which samples lie within the target's side.

    The filter lies mirrored about the patch's middle, which is between two samples.
    """
    return np.asarray(np.abs(np.arange(side) - (side + 1) / 2) * (2 / side) * scale <= 1)
