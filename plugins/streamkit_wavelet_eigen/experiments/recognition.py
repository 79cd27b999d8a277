"""Three readings of "feature extraction percentage", and recognition over all targets."""

from collections.abc import Callable, Sequence

import numpy as np

from streamkit_wavelet_eigen.experiments.methods import METHODS, PROPOSED, RAW, recognition_rate
from streamkit_wavelet_eigen.experiments.protocol import DatabaseSplit, first_targets
from streamkit_wavelet_eigen.experiments.published import TARGETS
from streamkit_wavelet_eigen.experiments.results import Figure, figure_of
from streamkit_wavelet_eigen.gallery import distances
from streamkit_wavelet_eigen.learner import learn_space
from streamkit_wavelet_eigen.recipe import Recipe

# Reading B: share of the variance of the training images in the eigenvectors.
KEPT_ENERGY = 0.95
MAX_COMPONENTS = 256


def rates(recipe: Recipe, splits: Sequence[DatabaseSplit]) -> Figure:
    """Recognition over all targets, percent; one measurement per split."""
    return figure_of([recognition_rate(recipe, split) for split in splits])


def reading_a(recipe: Recipe, splits: Sequence[DatabaseSplit]) -> list[Figure]:
    """Recognition among the first k targets of each split, k = 1 to 10, percent.

    Basis and gallery come from the training images of these targets alone.
    """
    return _by_targets(splits, lambda split: recognition_rate(recipe, split))


def reading_b(splits: Sequence[DatabaseSplit]) -> list[Figure]:
    """Held-out reconstruction of k targets, k = 1 to 10, percent: the mean of 100 (1 - |x - x'| / |x|).

    x is a raw test image, x' its reconstruction from the whole-image eigenvectors that hold 95 % of the
    variance of the k targets' training images.
    """
    return _by_targets(splits, reconstructed_share)


def reading_c(splits: Sequence[DatabaseSplit]) -> list[Figure]:
    """Recognition over all targets with the paper chain and 1 to 10 features for each block, percent."""
    return [figure_of(rates) for rates in zip(*map(rates_by_features, splits), strict=True)]


def _by_targets(splits: Sequence[DatabaseSplit], measure: Callable[[DatabaseSplit], float]) -> list[Figure]:
    return [figure_of([measure(first_targets(split, count)) for split in splits]) for count in TARGETS]


def reconstructed_share(split: DatabaseSplit) -> float:
    """Reading B of one split, percent."""
    components = min(len(split.training.labels), MAX_COMPONENTS)
    recipe = Recipe(64, RAW, components=components, energy=KEPT_ENERGY)
    space = learn_space(split.training.patches.astype(np.float32), recipe)
    given = split.test.patches.astype(np.float32)
    residual = np.linalg.norm((given - space.reconstruct(given)).reshape(len(given), -1), axis=1)
    whole = np.linalg.norm(given.reshape(len(given), -1), axis=1)
    return float(100.0 * np.mean(1.0 - residual / whole))


def rates_by_features(split: DatabaseSplit) -> list[float]:
    """Reading C of one split: one fit, of which the leading features are used."""
    recipe = METHODS[PROPOSED]
    space = learn_space(split.training.patches.astype(np.float32), recipe)
    blocks = recipe.blocks**2
    known, queries = (
        space.embed(sample.patches.astype(np.float32)).reshape(-1, blocks, recipe.components)
        for sample in (split.training, split.test)
    )
    names, truth = np.array(split.training.labels), np.array(split.test.labels)
    found = []
    for count in range(1, recipe.components + 1):
        one, other = (vectors[:, :, :count].reshape(len(vectors), -1) for vectors in (queries, known))
        nearest = distances(one, other, recipe.metric, blocks).argmin(axis=1)
        found.append(float(100.0 * np.mean(names[nearest] == truth)))
    return found
