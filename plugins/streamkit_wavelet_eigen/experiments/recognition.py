"""Recognition by the compared methods, the selection among candidates, and three readings of the tables."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from streamkit_wavelet_eigen.experiments.results import TARGETS, Figure, Selection, figure_of
from streamkit_wavelet_eigen.experiments.splits import DatabaseSplit, first_targets, inner_splits
from streamkit_wavelet_eigen.feature_space import learn_space
from streamkit_wavelet_eigen.gallery import Recogniser, distances
from streamkit_wavelet_eigen.recipe import PRESETS, Basis, Metric, Mode, Preprocessing, Recipe, Views

RAW = Preprocessing(Mode.RAW)
INNER_REPETITIONS = 2
# Reading B: share of the variance of the training images in the eigenvectors.
KEPT_ENERGY = 0.95
MAX_COMPONENTS = 256
PROPOSED = "paper chain, modular PCA (preset paper)"
TRADITIONAL = "raw pixels, whole-picture PCA 40 (traditional)"
MODULAR = "raw pixels, modular PCA (preset modular)"
BEST = "approximation, virtual views, Fisher (preset recognition)"

METHODS: dict[str, Recipe] = {
    PROPOSED: PRESETS["paper"],
    "paper chain, whole-picture PCA 40": Recipe(64, components=40),
    "db8 denoising only, modular PCA": replace(PRESETS["paper"], preprocessing=Preprocessing(Mode.DENOISE)),
    TRADITIONAL: Recipe(64, RAW, components=40),
    MODULAR: PRESETS["modular"],
    "raw pixels, modular PCA 5, one distance": replace(
        PRESETS["modular"], components=5, metric=Metric.EUCLIDEAN
    ),
    "raw pixels, sub-pattern PCA": replace(PRESETS["modular"], basis=Basis.PER_BLOCK),
    "raw pixels, whole-picture PCA 40, Fisher": Recipe(64, RAW, components=40, discriminative=True),
    BEST: PRESETS["recognition"],
}

# Candidates of model selection.
CANDIDATES: dict[str, Recipe] = {
    "modular": PRESETS["modular"],
    "no views, 40": replace(PRESETS["recognition"], views=Views.NONE, components=40),
    "shifted, 60": replace(PRESETS["recognition"], views=Views.SHIFTED),
    "mirrored, 40": replace(PRESETS["recognition"], components=40),
    "mirrored, 60": PRESETS["recognition"],
    "mirrored, 100": replace(PRESETS["recognition"], components=100),
}


def recognition_rate(recipe: Recipe, split: DatabaseSplit) -> float:
    """Percent of the test images whose nearest training image is of the same target."""
    training, test = split.training, split.test
    if len(set(training.labels)) < 2:
        # A Fisher step needs two targets; with one every answer is right.
        recipe = replace(recipe, discriminative=False)
    space = learn_space(training.patches.astype(np.float32), recipe, training.labels)
    vectors = space.embed(test.patches.astype(np.float32))
    matches = Recogniser(recipe, training).recognise(vectors, space)
    return 100.0 * float(np.mean(np.array(matches.labels) == np.array(test.labels)))


def choose(
    splits: Sequence[DatabaseSplit], per_target: int, candidates: Mapping[str, Recipe] = CANDIDATES
) -> Selection:
    """Selects a candidate on the training images of each split, then tests the selected one.

    The test images of a split have no influence on its choice. Among equal candidates the first wins.

    Args:
        splits: random divisions of a database.
        per_target: training images of each target.
        candidates: recipes by name.
    """
    inner_rates: dict[str, list[float]] = {name: [] for name in candidates}
    chosen: list[str] = []
    outer: list[float] = []
    for split in splits:
        inner = list(inner_splits(split.training, per_target, split.seed, INNER_REPETITIONS))
        for name, recipe in candidates.items():
            inner_rates[name].append(float(np.mean([recognition_rate(recipe, part) for part in inner])))
        best = max(candidates, key=lambda name: inner_rates[name][-1])
        chosen.append(best)
        outer.append(recognition_rate(candidates[best], split))
    return {
        "chosen": dict(sorted(Counter(chosen).items())),
        "inner": {name: figure_of(values) for name, values in inner_rates.items()},
        "outer": figure_of(outer),
    }


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
