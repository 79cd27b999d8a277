"""Appearance of one target: a mean patch and an eigen basis that follow it slowly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from streamkit.settings import setting
from streamkit_kernels import compiled, product
from streamkit_tracker.window_geometry import Float32Array

DEVIATION_FLOOR = 4.0
TEXTURE_FLOOR = 0.05
WEAKEST = 1e-6  # of the largest eigenvalue: what is below is rounding
NOISE_SHARE = 0.02  # residual a pixel has anyway; directions that vary less are hardly subtracted


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
    it joins every update, so that the model cannot walk away from the target it was started on. The part
    of a patch inside the eigen space is subtracted only as far as it varies more than the noise
    (probabilistic PCA); else small misalignments would be learnt and no longer count: the window would creep.

    Source: Ross, Lim, Lin and Yang, Incremental Learning for Robust Visual Tracking, IJCV 77, 2008
    (sequential Karhunen-Loeve with mean update); Tipping and Bishop, Probabilistic PCA, 1999.

    Attributes:
        textured: whether the first patch has any structure to compare.
        rows: float32[c + 2, p], c the largest size of the basis: the basis, shrunk by its noise, zeros,
            the mean, ones.
        constants: float32[2, c + 1], the sums of these rows but the last, and their products with the mean.

    Args:
        patch: float32[p], grey levels minus 128 of the first window.
        settings: how it learns.
    """

    space = None  # it needs none

    def __init__(self, patch: Float32Array, settings: EigenSettings | None = None) -> None:
        self._settings = settings or EigenSettings()
        self.anchor = normalise(np.ascontiguousarray(patch)[None])[0]
        self.textured = bool(np.mean(self.anchor**2) > TEXTURE_FLOOR)
        self.mean = self.anchor.copy()
        self.basis = np.zeros((0, patch.size), np.float32)
        self.singular_values = np.zeros(0, np.float32)
        self._count = 1.0
        self._waiting: list[Float32Array] = []
        self._prepare_comparison()

    def update(self, patch: Float32Array) -> None:
        """Learns a patch, float32[p] grey levels; takes effect when a batch is complete."""
        self._waiting.append(patch)
        if len(self._waiting) < self._settings.batch:
            return
        # sequential Karhunen-Loeve step
        learnt = np.concatenate([normalise(np.stack(self._waiting)), self.anchor[None]])
        self._waiting.clear()
        new, past = len(learnt), self._count * self._settings.forgetting
        centre = learnt.mean(axis=0)
        step = centre - self.mean
        known = (math.sqrt(self._settings.forgetting) * self.singular_values)[:, None] * self.basis
        rows = np.concatenate(
            [known, learnt - centre, math.sqrt(past * new / (past + new)) * step[None]], dtype=np.float32
        )
        self.mean = self.mean + np.float32(new / (past + new)) * step
        self._count = past + new
        # the right singular vectors of a few dozen rows, by the eigenvectors of their Gram matrix
        wide = rows.astype(np.float64)
        values, vectors = np.linalg.eigh(product(wide, wide.T))
        strongest = np.flatnonzero(values > WEAKEST * max(values[-1], 1e-12))[::-1]
        strongest = strongest[: self._settings.eigenvectors]
        singular = np.sqrt(values[strongest])
        basis = product(np.ascontiguousarray(vectors[:, strongest].T), wide) / singular[:, None]
        self.basis, self.singular_values = basis.astype(np.float32), singular.astype(np.float32)
        self._prepare_comparison()

    def _prepare_comparison(self) -> None:
        """Prepares the factors of the product with patches, see `rows` and `constants`."""
        components, power = self._settings.eigenvectors, self.singular_values**2
        shrinkage = np.sqrt(power / (power + NOISE_SHARE * len(self.mean) * self._count))
        self.rows = np.zeros((components + 2, len(self.mean)), np.float32)
        self.rows[: len(self.basis)] = shrinkage[:, None] * self.basis
        self.rows[components:] = self.mean, np.ones_like(self.mean)
        used = self.rows[:-1]
        self.constants = np.stack([used.sum(axis=1), product(used, self.mean[:, None])[:, 0]])


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
