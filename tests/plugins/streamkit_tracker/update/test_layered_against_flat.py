"""Layered sampling against a flat filter with the same number of evaluations and the same template."""

from types import ModuleType

import numpy as np


def steps(scene):
    """The frames and true windows of a scene whose camera stands still."""
    return [(image, truth, np.zeros(2)) for image, truth in scene]


def test_layers_are_nearer_at_equal_evaluations(scenes: ModuleType, layered_and_flat: ModuleType):
    """Errors of the layered filter are at most 0.7 of the flat one's, over three sequences."""

    def errors(seed: int, layered: bool) -> tuple[float, float]:
        return layered_and_flat.follow(
            steps(scenes.TurningScene(seed=seed, frames=40)), layered=layered, seed=3
        )

    assert layered_and_flat.EVALUATIONS == 220 + 72 + 72
    layered = np.mean([errors(seed, True) for seed in (5, 6, 7)], axis=0)
    flat = np.mean([errors(seed, False) for seed in (5, 6, 7)], axis=0)
    assert layered[0] <= 0.7 * flat[0]
    assert layered[1] <= 0.7 * flat[1]
