"""The choice of a configuration on splits of the training pictures alone, and what it is then worth."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TypedDict

import numpy as np

from streamkit_wavelet_eigen.experiments.figures_of_merit import Figure, figure_of
from streamkit_wavelet_eigen.experiments.methods import CANDIDATES, recognition_rate
from streamkit_wavelet_eigen.experiments.protocol import Split, inner_splits
from streamkit_wavelet_eigen.recipe import Recipe

INNER_REPETITIONS = 2


class Selection(TypedDict):
    """What the choice came to.

    `chosen` counts how often each candidate won; `inner` has each candidate's mean rate on the inner splits;
    `outer` is the rate on test pictures of the one that each split chose for itself.
    """

    chosen: dict[str, int]
    inner: dict[str, Figure]
    outer: Figure


def choose(
    splits: Sequence[Split], per_target: int, candidates: Mapping[str, Recipe] = CANDIDATES
) -> Selection:
    """Lets the training pictures of each split choose among the candidates, then tests the chosen one.

    A split's test pictures have no part in its choice. Of equal candidates the first wins.

    Args:
        splits: with test pictures that only the last figure sees.
        per_target: training pictures of each target.
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
