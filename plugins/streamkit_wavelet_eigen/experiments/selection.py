"""Model selection on splits of the training images alone, and the rate of the selected recipe."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from streamkit_wavelet_eigen.experiments.methods import CANDIDATES, recognition_rate
from streamkit_wavelet_eigen.experiments.protocol import Split, inner_splits
from streamkit_wavelet_eigen.experiments.results import Selection, figure_of
from streamkit_wavelet_eigen.recipe import Recipe

INNER_REPETITIONS = 2


def choose(
    splits: Sequence[Split], per_target: int, candidates: Mapping[str, Recipe] = CANDIDATES
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
