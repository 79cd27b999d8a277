"""What an experiment has found, as it is in its JSON file."""

from typing import TypedDict

from streamkit_wavelet_eigen.experiments.figures_of_merit import Figure
from streamkit_wavelet_eigen.experiments.selection import Selection

SCHEMA = "streamkit.experiments/1"


class PartitionResult(TypedDict):
    """Everything measured on one partition; percent, and px for `tracking`."""

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
    """The whole experiment."""

    schema: str
    repetitions: int
    tracking_runs: int
    partitions: dict[str, PartitionResult]
