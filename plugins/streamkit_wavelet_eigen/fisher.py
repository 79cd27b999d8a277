"""The Fisher step: axes that separate vectors of different labels and keep those of one label close."""

from collections.abc import Sequence

import numpy as np

from streamkit_wavelet_eigen.eigenspace import FloatArray


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
