"""Appearance of one target: a mean patch and an eigen basis that follow it slowly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.calling_thread import product
from streamkit_tracker.frame_crops import Float32Array
from streamkit_tracker.window_geometry import FloatArray

DEVIATION_FLOOR = 4.0
TEXTURE_FLOOR = 0.05
EVERY = slice(None)
NOISE_SHARE = 0.02  # residual a pixel has anyway; directions that vary less are not forgiven


@dataclass(frozen=True)
class EigenSettings:
    """How an eigen template learns.

    Attributes:
        components: largest number of eigenvectors kept.
        batch: patches gathered before the basis is updated.
        forgetting: weight of the past at each update, 0 to 1.
    """

    components: int = 16
    batch: int = 5
    forgetting: float = 0.95


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
        self.anchor = normalise(patch[None])[0]
        self.textured = bool(np.mean(self.anchor**2) > TEXTURE_FLOOR)
        self.mean = self.anchor.copy()
        self.basis = np.zeros((0, patch.size), np.float32)
        self.singular_values = np.zeros(0, np.float32)
        self._count = 1.0
        self._waiting: list[Float32Array] = []
        self._stack()

    def update(self, patch: Float32Array) -> None:
        """Learns a patch, float32[p] grey levels; takes effect when a batch is complete."""
        self._waiting.append(patch)
        if len(self._waiting) >= self._settings.batch:
            learnt = normalise(np.stack(self._waiting))
            self._waiting.clear()
            self._merge(np.concatenate([learnt, self.anchor[None]]))
            self._stack()

    def _merge(self, samples: Float32Array) -> None:
        """Sequential Karhunen-Loeve step with the rows of `samples`, float32[n, p]."""
        new, known = len(samples), len(self.basis)
        past = self._count * self._settings.forgetting
        sample_mean = samples.mean(axis=0)
        rows = np.empty((known + new + 1, samples.shape[1]), np.float32)
        scales = np.sqrt(np.float32(self._settings.forgetting)) * self.singular_values
        np.multiply(self.basis, scales[:, None], out=rows[:known])
        np.subtract(samples, sample_mean, out=rows[known:-1])
        np.subtract(sample_mean, self.mean, out=rows[-1])
        rows[-1] *= np.float32(np.sqrt(past * new / (past + new)))
        # the Gram matrix is tiny beside the patch: its eigenvectors give the basis at a fraction of an SVD
        values, vectors = np.linalg.eigh(product(rows, rows.T).astype(np.float64))
        order = np.argsort(values)[::-1][: self._settings.components]
        order = order[values[order] > 1e-6 * max(float(values[-1]), 1e-12)]
        singular = np.sqrt(values[order])
        self.basis = product((vectors[:, order] / singular).T.astype(np.float32), rows)
        self.singular_values = np.asarray(singular, np.float32)
        self.mean = np.asarray((past * self.mean + new * sample_mean) / (past + new), np.float32)
        self._count = past + new

    def _stack(self) -> None:
        """Prepares float32[components + 2, p]: the basis as far as it is forgiven, the mean and ones."""
        pixels = self.mean.size
        self.rows = np.zeros((self._settings.components + 2, pixels), np.float32)
        variances = self.singular_values**2 / self._count
        forgiven = np.sqrt(variances / (variances + NOISE_SHARE * pixels))
        np.multiply(self.basis, forgiven[:, None], out=self.rows[: len(self.basis)])
        self.rows[-2] = self.mean
        self.rows[-1] = 1.0
        self.constants = np.stack([self.rows[:-1].sum(axis=1), self.rows[:-1] @ self.mean])


class EigenStack:
    """Templates of t targets side by side, to be compared with several patches each.

    Args:
        templates: t of them, with the same number of components.
    """

    def __init__(self, templates: Sequence[EigenTemplate]) -> None:
        self._columns = np.stack([template.rows for template in templates]).transpose(0, 2, 1)
        self._constants = np.stack([template.constants for template in templates])

    def distances(self, patches: Float32Array, chosen: slice = EVERY) -> FloatArray:
        """Mean squared residuals of normalised patches.

        The normalisation is folded into one product with [basis, mean, 1], so no normalised copy is made.

        Args:
            patches: float32[c, n, p], grey levels minus 128, for the c templates that are `chosen`.
            chosen: which of the templates.

        Returns:
            float64[c, n]; 0 is a perfect match, about 2 an unrelated patch.
        """
        products = product(patches, self._columns[chosen])
        result = np.empty(patches.shape[:2])
        power = np.vecdot(patches, patches)
        _residuals(products, power, self._constants[chosen], patches.shape[2], result)
        return result


def eigen_distances(templates: Sequence[EigenTemplate], patches: Float32Array) -> FloatArray:
    """Distances float64[t, n] of patches float32[t, n, p] to t templates, see `EigenStack`."""
    return EigenStack(templates).distances(patches)


def normalise(patches: Float32Array) -> Float32Array:
    """float32[n, p] grey levels with mean 0 and deviation 1, or less where the patch is flat."""
    centred = patches - patches.mean(axis=1, keepdims=True)
    deviation = np.maximum(np.sqrt(np.vecdot(centred, centred) / patches.shape[1]), DEVIATION_FLOOR)[:, None]
    return np.asarray(centred / deviation, np.float32)


@compiled
def _residuals(
    products: Float32Array, power: Float32Array, constants: Float32Array, pixels: int, result: FloatArray
) -> None:
    """What of the normalised patches lies outside the eigen spaces, mean squares.

    Args:
        products: float32[c, n, k + 2], patches times [basis, mean, 1].
        power: float32[c, n], sums of squares of the patches.
        constants: float32[c, 2, k + 1], sums of [basis, mean] and their products with the mean.
        pixels: of a patch.
        result: float64[c, n], is filled.
    """
    known = products.shape[2] - 2
    for template in range(result.shape[0]):
        sums, mean_products = constants[template, 0], constants[template, 1]
        for patch in range(result.shape[1]):
            row = products[template, patch]
            average = row[known + 1] / pixels
            variance = max(power[template, patch] / pixels - average**2, 0.0)
            deviation = max(np.sqrt(variance), DEVIATION_FLOOR)
            like_mean = (row[known] - average * sums[known]) / deviation
            outside = pixels * variance / deviation**2 - 2 * like_mean + mean_products[known]
            for component in range(known):
                along = (row[component] - average * sums[component]) / deviation
                outside -= (along - mean_products[component]) ** 2
            result[template, patch] = max(outside, 0.0) / pixels
