"""Principal components of window vectors, in one batch or updated, and the Fisher step on them.

Equations are those of Zhang, Liu and Qu, whose method docs/wavelet-eigen.md describes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import product

FloatArray: TypeAlias = NDArray[np.float64]

# Directions weaker than this share of the strongest are rounding noise.
RELATIVE_FLOOR = 1e-3


@dataclass(frozen=True, eq=False)
class Eigenspace:
    """Mean and leading eigenvectors of a set of vectors; arrays are read-only.

    Attributes:
        mean: float64[d], equation 5.
        basis: float64[k, d], orthonormal rows, strongest first; k may be 0.
        singular_values: float64[k] of the centred data; eigenvalues of equation 6 are their squares / count.
        count: number of vectors, older ones down-weighted by forgetting.
    """

    mean: FloatArray
    basis: FloatArray
    singular_values: FloatArray
    count: float

    def __post_init__(self) -> None:
        for array in (self.mean, self.basis, self.singular_values):
            array.setflags(write=False)

    @property
    def rank(self) -> int:
        """Number of eigenvectors."""
        return len(self.singular_values)

    def truncated(self, components: int, energy: float = 1.0) -> "Eigenspace":
        """This space with at most `components` eigenvectors, or the fewest that keep `energy` of it."""
        kept = _component_count(self.singular_values, components, energy, len(self.mean))
        if kept == self.rank:
            return self
        return Eigenspace(self.mean, self.basis[:kept].copy(), self.singular_values[:kept].copy(), self.count)

    def project(self, vectors: FloatArray) -> FloatArray:
        """Coordinates float64[n, k] of vectors float64[n, d]."""
        result: FloatArray = product(vectors - self.mean, self.basis.T)
        return result

    def reconstruct(self, coordinates: FloatArray) -> FloatArray:
        """Vectors float64[n, d] of coordinates float64[n, k]."""
        result: FloatArray = product(coordinates, self.basis) + self.mean
        return result


def learn_eigenspace(vectors: FloatArray, components: int, energy: float = 1.0) -> Eigenspace:
    """Principal components of a batch, by the small Gram matrix.

    With M vectors of d values and M < d, the eigenvectors of X^T X (d x d) come from those of X X^T (M x M);
    the large matrix is never formed.

    Args:
        vectors: float64[m, d], m >= 1, all finite.
        components: maximum number of eigenvectors, at least 1.
        energy: share of the variance to keep with the fewest eigenvectors, 0 < energy <= 1.

    Returns:
        The space; for one vector, or equal vectors, it has a mean and no eigenvector.

    Raises:
        ValueError: there is no vector, or one is not finite.

    Source: equations 5 and 6; Sirovich and Kirby, 1987; Turk and Pentland, 1991.
    """
    vectors = _validated(vectors)
    mean = vectors.mean(axis=0)
    basis, singular_values = _principal_components(vectors - mean, components, energy)
    return Eigenspace(mean, basis, singular_values, float(len(vectors)))


def update_eigenspace(
    space: Eigenspace, vectors: FloatArray, components: int, forgetting: float = 1.0
) -> Eigenspace:
    """Adds a batch of vectors to a space without the vectors it was learnt from.

    Args:
        space: the space so far.
        vectors: float64[m, d], m >= 1, all finite.
        components: maximum number of eigenvectors, at least 1.
        forgetting: weight of the space so far, 0 < forgetting <= 1; 1 forgets nothing.

    Returns:
        A new space. With forgetting 1 and enough components it equals `learn_eigenspace` of all vectors.

    Raises:
        ValueError: vectors have another length, there is none, or one is not finite.

    Source: Levy and Lindenbaum, Sequential Karhunen-Loeve, 2000, with the mean update of Ross, Lim, Lin and
        Yang, Incremental learning for robust visual tracking, 2008. They weight the scatter by the square of
        the forgetting factor and the count by the factor; here the factor weights both, so that eigenvalues
        stay variances.
    """
    vectors = _validated(vectors)
    if vectors.shape[1] != len(space.mean):
        raise ValueError(
            f"eigenspace update: vectors must have {len(space.mean)} values as the space has, "
            f"got {vectors.shape[1]}; use windows of the same patch size"
        )
    known, added = forgetting * space.count, float(len(vectors))
    count = known + added
    batch_mean = vectors.mean(axis=0)
    shift = batch_mean - space.mean
    rows = np.vstack(
        [
            np.sqrt(forgetting) * space.singular_values[:, None] * space.basis,
            vectors - batch_mean,
            np.sqrt(known * added / count) * shift[None],
        ]
    )
    basis, singular_values = _principal_components(rows, components)
    return Eigenspace(space.mean + (added / count) * shift, basis, singular_values, count)


def learn_fisher_axes(coordinates: FloatArray, labels: Sequence[str], shrinkage: float = 0.1) -> FloatArray:
    """Axes of linear discriminant analysis with a shrunk within-class scatter.

    Few images per class underestimate the weak directions of the scatter, and unshrunk axes follow them.
    Shrinkage replaces dropping eigenvectors until the scatter is regular.

    Args:
        coordinates: float64[m, d].
        labels: m class names; at least two different.
        shrinkage: 0 to 1.

    Returns:
        float64[d, min(d, classes - 1)], scaled so that the shrunk within-class scatter is 1 along each axis.

    Raises:
        ValueError: there are fewer than two classes, or no class has two vectors.

    Source: Belhumeur, Hespanha and Kriegman, Eigenfaces vs. Fisherfaces, 1997; Friedman, Regularized
        discriminant analysis, 1989.
    """
    from scipy.linalg import eigh  # here, as only this step needs it

    names, index = np.unique(np.asarray(labels), return_inverse=True)
    counts = np.bincount(index)
    if len(names) < 2 or counts.max() < 2:
        raise ValueError(
            f"Fisher step: at least two labels are needed, and two windows of one, got {len(coordinates)} "
            f"windows of {len(names)} labels; give more labelled windows or switch discriminative off"
        )
    means = np.zeros((len(names), coordinates.shape[1]))
    np.add.at(means, index, coordinates)
    means /= counts[:, None]
    inner = coordinates - means[index]
    outer = (means - coordinates.mean(axis=0)) * np.sqrt(counts)[:, None]
    within, between = inner.T @ inner / len(index), outer.T @ outer / len(index)
    isotropic = np.trace(within) / len(within)
    # Equal windows have no scatter, and eigh needs a positive definite matrix.
    floor = max(1e-9 * float(np.trace(between)), 1e-12)
    within = (1.0 - shrinkage) * within + (shrinkage * isotropic + floor) * np.eye(len(within))
    _, axes = eigh(between, within)
    kept: FloatArray = axes[:, ::-1][:, : min(len(within), len(names) - 1)]
    strongest = np.abs(kept).argmax(axis=0)
    signs = np.where(kept[strongest, np.arange(kept.shape[1])] < 0, -1.0, 1.0)
    result: FloatArray = np.ascontiguousarray(kept * signs)
    return result


def _validated(vectors: FloatArray) -> FloatArray:
    vectors = np.asarray(vectors, dtype=np.float64)
    if vectors.ndim != 2 or not len(vectors):
        raise ValueError(f"eigenspace: vectors must be [m, d] with m >= 1, got shape {vectors.shape}")
    if not np.isfinite(vectors).all():
        raise ValueError("eigenspace: vectors must be finite, got NaN or infinity; leave such windows out")
    return vectors


def _principal_components(
    rows: FloatArray, components: int, energy: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Leading right singular vectors float64[k, d] and values float64[k] of float64[m, d]."""
    tall = rows.shape[0] > rows.shape[1]
    squares, vectors = np.linalg.eigh(product(rows.T, rows) if tall else product(rows, rows.T))
    singular_values = np.sqrt(np.maximum(squares[::-1], 0.0))
    kept = _component_count(singular_values, components, energy, rows.shape[1])
    leading = vectors[:, ::-1][:, :kept].T
    basis = leading.copy() if tall else product(leading, rows) / singular_values[:kept, None]
    # The sign of an eigenvector is arbitrary; a positive largest element makes runs comparable.
    strongest = np.abs(basis).argmax(axis=1)
    basis *= np.where(basis[np.arange(kept), strongest] < 0, -1.0, 1.0)[:, None]
    return basis, singular_values[:kept].copy()


def _component_count(singular_values: FloatArray, components: int, energy: float, length: int) -> int:
    """Number of eigenvectors to keep: above rounding noise, at most `components`, enough for the energy."""
    if not len(singular_values):
        return 0
    # The absolute floor is for rows that differ by rounding only: there the strongest is rounding as well.
    floor = max(RELATIVE_FLOOR * float(singular_values[0]), 1e-9 * float(np.sqrt(length)))
    kept = min(components, int(np.count_nonzero(singular_values > floor)))
    if energy >= 1.0 or not kept:
        return kept
    cumulative = np.cumsum(singular_values**2)
    return min(kept, int(np.searchsorted(cumulative, energy * cumulative[-1])) + 1)
