"""Appearance of one target: a mean patch and an eigen basis that follow it slowly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from streamkit.settings import setting
from streamkit_kernels import compiled
from streamkit_tracker.appearance.frame_crops import Float32Array
from streamkit_tracker.appearance.principal_rows import principal_rows

DEVIATION_FLOOR = 4.0
TEXTURE_FLOOR = 0.05
NOISE_SHARE = 0.02  # residual a pixel has anyway; directions that vary less are not forgiven


@dataclass(frozen=True)
class EigenSettings:
    """How an eigen template learns."""

    eigenvectors: int = setting(16, min=0, max=128, doc="Largest size of a template's eigen basis.")
    batch: int = setting(5, min=1, max=100, unit="frames", doc="Patches learnt at once.")
    forgetting: float = setting(0.95, min=0.01, max=1.0, doc="Weight of the past at each update.")


class EigenTemplate:
    """Mean and incremental eigen basis of a target's normalised patches.

    Patches are compared after their mean is taken off and their standard deviation (at least 4 grey
    levels) is divided out, so that a change of light does not count. The first patch is kept as an anchor:
    it joins every update, so that the model cannot walk away from the target it was started on. What lies
    inside the eigen space is forgiven only as far as it varies more than the noise (probabilistic PCA);
    else the basis would learn small misalignments and forgive them, and the window would creep.

    Source: Ross, Lim, Lin and Yang, Incremental Learning for Robust Visual Tracking, IJCV 77, 2008
    (sequential Karhunen-Loeve with mean update); Tipping and Bishop, Probabilistic PCA, 1999.

    Attributes:
        textured: whether the first patch has any structure to compare.

    Args:
        patch: float32[p], grey levels minus 128 of the first window.
        settings: how it learns.
    """

    def __init__(self, patch: Float32Array, settings: EigenSettings | None = None) -> None:
        self._settings = settings or EigenSettings()
        self.anchor = normalise(np.ascontiguousarray(patch)[None])[0]
        self.textured = bool(np.mean(self.anchor**2) > TEXTURE_FLOOR)
        self.mean = self.anchor.copy()
        self.basis = np.zeros((0, patch.size), np.float32)
        self.singular_values = np.zeros(0, np.float32)
        self._count = 1.0
        self._waiting: list[Float32Array] = []
        components = self._settings.eigenvectors
        self.rows, self.constants = _forgive(
            self.basis, self.singular_values, self.mean, self._count, components
        )

    def update(self, patch: Float32Array) -> None:
        """Learns a patch, float32[p] grey levels; takes effect when a batch is complete."""
        self._waiting.append(patch)
        if len(self._waiting) >= self._settings.batch:
            learnt = normalise(np.concatenate(self._waiting).reshape(-1, patch.size))
            self._waiting.clear()
            self._merge(learnt)

    def _merge(self, learnt: Float32Array) -> None:
        """Sequential Karhunen-Loeve step with the rows of `learnt`, float32[n, p], and the anchor."""
        new = len(learnt) + 1
        past = self._count * self._settings.forgetting
        rows = np.empty((len(self.basis) + new + 1, learnt.shape[1]), np.float32)
        mean = np.empty_like(self.mean)
        _lay_out(
            self.basis,
            np.sqrt(np.float32(self._settings.forgetting)) * self.singular_values,
            self.mean,
            learnt,
            self.anchor,
            past,
            rows,
            mean,
        )
        most = min(self._settings.eigenvectors, len(rows))
        basis, singular_values = np.empty((most, len(mean)), np.float32), np.empty(most, np.float32)
        kept = principal_rows(rows, basis, singular_values)
        self.basis, self.singular_values = basis[:kept], singular_values[:kept]
        self.mean = mean
        self._count = past + new
        components = self._settings.eigenvectors
        self.rows, self.constants = _forgive(
            basis[:kept], singular_values[:kept], mean, self._count, components
        )


@compiled
def normalise(patches: Float32Array) -> Float32Array:
    """float32[n, p] grey levels with mean 0 and deviation 1, or less where the patch is flat."""
    result = np.empty(patches.shape, np.float32)
    pixels = patches.shape[1]
    for index in range(len(patches)):
        patch, normal = patches[index], result[index]
        total = 0.0
        for pixel in range(pixels):
            total += patch[pixel]
        average, power = np.float32(total / pixels), 0.0
        for pixel in range(pixels):
            power += (patch[pixel] - average) ** 2
        deviation = np.float32(max(np.sqrt(power / pixels), DEVIATION_FLOOR))
        for pixel in range(pixels):
            normal[pixel] = (patch[pixel] - average) / deviation
    return result


@compiled
def _lay_out(
    basis: Float32Array,
    scales: Float32Array,
    mean: Float32Array,
    learnt: Float32Array,
    anchor: Float32Array,
    past: float,
    rows: Float32Array,
    merged: Float32Array,
) -> None:
    """Lays out what the new basis is the principal directions of, and weighs the new mean.

    Args:
        basis: float32[k, p], what is known.
        scales: float32[k], of its rows.
        mean: float32[p], what is known.
        learnt: float32[n, p], normalised patches.
        anchor: float32[p], one more.
        past: weight of what is known.
        rows: float32[k + n + 2, p], is filled: the scaled basis, the patches off their mean, its own step.
        merged: float32[p], is filled: the new mean.
    """
    known, count = len(basis), len(learnt)
    new = count + 1
    for row in range(known):
        for pixel in range(len(mean)):
            rows[row, pixel] = basis[row, pixel] * scales[row]
    centre = rows[known + new]
    centre[:] = anchor
    for row in range(count):
        for pixel in range(len(mean)):
            centre[pixel] += learnt[row, pixel]
    share = np.float32(1.0 / new)
    for pixel in range(len(mean)):
        centre[pixel] *= share
    for row in range(count):
        for pixel in range(len(mean)):
            rows[known + row, pixel] = learnt[row, pixel] - centre[pixel]
    weight = np.float32(np.sqrt(past * new / (past + new)))
    gain = np.float32(new / (past + new))
    for pixel in range(len(mean)):
        step = centre[pixel] - mean[pixel]
        rows[known + count, pixel] = anchor[pixel] - centre[pixel]
        merged[pixel] = mean[pixel] + gain * step
        centre[pixel] = weight * step


@compiled
def _forgive(
    basis: Float32Array, singular_values: Float32Array, mean: Float32Array, count: float, components: int
) -> tuple[Float32Array, Float32Array]:
    """Factors of the product with patches.

    Args:
        basis: float32[k, p].
        singular_values: float32[k].
        mean: float32[p].
        count: number of patches that were learnt, weighted.
        components: c, largest number of rows of a basis.

    Returns:
        float32[c + 2, p]: the basis as far as it is forgiven, zeros, the mean, ones; and float32[2, c + 1]:
        the sums of these rows but the last, and their products with the mean.
    """
    rows = np.empty((components + 2, len(mean)), np.float32)
    constants = np.empty((2, components + 1), np.float32)
    noise = NOISE_SHARE * len(mean) * count
    last = len(rows) - 1
    rows[len(basis) : last] = 0.0
    for row in range(len(basis)):
        power = singular_values[row] ** 2
        forgiven = np.float32(np.sqrt(power / (power + noise)))
        for pixel in range(len(mean)):
            rows[row, pixel] = basis[row, pixel] * forgiven
    rows[last - 1], rows[last] = mean, 1.0
    for row in range(last):
        total, along = 0.0, 0.0
        for pixel in range(len(mean)):
            total += rows[row, pixel]
            along += rows[row, pixel] * mean[pixel]
        constants[0, row], constants[1, row] = total, along
    return rows, constants
