"""Peer implementations on the same splits: scikit-learn's PCA and Fisherfaces, scikit-image's LBP."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.experiments.results import Figure, figure_of
from streamkit_wavelet_eigen.experiments.splits import DatabaseSplit
from streamkit_wavelet_eigen.gallery import Gallery

COMPONENTS = 40
LBP_CELLS = 8
LBP_POINTS = 8
LBP_RADIUS = 2
LBP_PATTERNS = LBP_POINTS * (LBP_POINTS - 1) + 3

Rate = Callable[[DatabaseSplit], float]


def peer_rates(splits: Sequence[DatabaseSplit]) -> dict[str, Figure]:
    """Recognition of each peer over all targets, percent.

    Raises:
        ImportError: scikit-learn or scikit-image is not installed.
    """
    return {name: figure_of([rate(split) for split in splits]) for name, rate in PEERS.items()}


def pca_rate(split: DatabaseSplit, *further_steps: object) -> float:
    """scikit-learn PCA with 40 components, nearest neighbour."""
    from sklearn.decomposition import PCA
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.pipeline import make_pipeline

    model = make_pipeline(PCA(COMPONENTS, svd_solver="full"), *further_steps, KNeighborsClassifier(1))
    fitted = model.fit(_rows(split.training), split.training.labels)
    return float(100.0 * np.mean(fitted.predict(_rows(split.test)) == np.array(split.test.labels)))


def fisherfaces_rate(split: DatabaseSplit) -> float:
    """scikit-learn PCA with 40 components, linear discriminant analysis, nearest neighbour."""
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis

    return pca_rate(split, LinearDiscriminantAnalysis(solver="eigen"))


def lbp_rate(split: DatabaseSplit) -> float:
    """scikit-image uniform LBP (8 points, radius 2), histograms of 8x8 cells, nearest by chi square."""
    from sklearn.metrics.pairwise import additive_chi2_kernel

    known, queries = (lbp_histograms(sample.patches) for sample in (split.training, split.test))
    nearest = additive_chi2_kernel(queries, known).argmax(axis=1)
    return float(100.0 * np.mean(np.array(split.training.labels)[nearest] == np.array(split.test.labels)))


def lbp_histograms(images: NDArray[np.uint8]) -> NDArray[np.float64]:
    """float64[n, cells * patterns] of uint8[n, h, w], the cells' histograms concatenated."""
    return np.stack([_lbp_histogram(image.tobytes(), image.shape) for image in images])


@cache
def _lbp_histogram(pixels: bytes, shape: tuple[int, int]) -> NDArray[np.float64]:
    """The histograms of one image; cached, because all splits have the same images."""
    from skimage.feature import local_binary_pattern

    image = np.frombuffer(pixels, np.uint8).reshape(shape)
    place = np.arange(shape[1]) // (shape[1] // LBP_CELLS)
    cells = (place[:, None] * LBP_CELLS + place) * LBP_PATTERNS
    codes = local_binary_pattern(image, LBP_POINTS, LBP_RADIUS, method="nri_uniform")  # type: ignore[no-untyped-call]
    counts = np.bincount((cells + codes.astype(int)).ravel(), minlength=LBP_CELLS**2 * LBP_PATTERNS)
    return counts.astype(np.float64)


PEERS: dict[str, Rate] = {
    "scikit-learn PCA 40, 1-NN": pca_rate,
    "scikit-learn Fisherfaces (PCA 40, LDA), 1-NN": fisherfaces_rate,
    "scikit-image LBP histograms, 1-NN chi square": lbp_rate,
}


def _rows(sample: Gallery) -> NDArray[np.float64]:
    return sample.patches.reshape(len(sample), -1).astype(np.float64)
