"""Results of the experiments, as in their JSON file."""

from collections.abc import Sequence
from typing import TypedDict

import numpy as np

SCHEMA = "streamkit.experiments/1"


class Figure(TypedDict):
    """Mean, sample deviation and number of measurements, rounded so that runs compare byte for byte."""

    mean: float
    deviation: float
    n: int


def figure_of(values: Sequence[float]) -> Figure:
    """Mean and deviation of measurements; the deviation of a single one is 0."""
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return {"mean": round(float(np.mean(values)), 2), "deviation": round(deviation, 2), "n": len(values)}


class Selection(TypedDict):
    """Outcome of model selection.

    `chosen` counts the wins of each candidate; `inner` has each candidate's mean rate on the inner splits;
    `outer` is the rate on test images of the candidate that each split chose.
    """

    chosen: dict[str, int]
    inner: dict[str, Figure]
    outer: Figure


class PartitionResult(TypedDict):
    """Measurements on one partition; percent, and px for `tracking`."""

    training_pictures: int
    test_pictures: int
    recognition: dict[str, Figure]
    peers: dict[str, Figure]
    selection: Selection
    reading_a: dict[str, list[Figure]]
    reading_b: list[Figure]
    reading_c: list[Figure]
    tracking: list[Figure]


class Results(TypedDict):
    """The whole experiment; partitions by their key."""

    schema: str
    repetitions: int
    tracking_runs: int
    partitions: dict[str, PartitionResult]
