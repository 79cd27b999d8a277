"""The compared methods, as recipes of this package, and the selection among candidates."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from streamkit_wavelet_eigen.experiments.protocol import DatabaseSplit, inner_splits
from streamkit_wavelet_eigen.experiments.results import Selection, figure_of
from streamkit_wavelet_eigen.gallery import Recogniser, accuracy, prepare_gallery
from streamkit_wavelet_eigen.learner import learn_space
from streamkit_wavelet_eigen.preprocessing import Mode, Preprocessing
from streamkit_wavelet_eigen.recipe import PRESETS, Basis, Metric, Recipe, Views

RAW = Preprocessing(Mode.RAW)
PROPOSED = "paper chain, modular PCA (preset paper)"
TRADITIONAL = "raw pixels, whole-picture PCA 40 (traditional)"
MODULAR = "raw pixels, modular PCA (preset modular)"
INNER_REPETITIONS = 2
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
    recogniser = Recogniser(space, prepare_gallery(training, recipe))
    matches = recogniser.recognise(space.embed(test.patches.astype(np.float32)))
    return 100.0 * accuracy(matches.labels, test.labels)


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
