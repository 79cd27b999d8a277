"""What is measured, as in the JSON file of the results, and the published tables beside it."""

from collections.abc import Sequence
from importlib.resources import files
from typing import TypedDict

import msgspec
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


class PublishedTable(msgspec.Struct, frozen=True):
    """One table as printed.

    Attributes:
        number: 1 to 4.
        rows: values of the first column.
        columns: the values of each partition, by its key.
        average: the printed average over all cells.
    """

    number: int
    rows: tuple[int, ...]
    columns: dict[str, tuple[float, ...]]
    average: float

    @property
    def recomputed_average(self) -> float:
        """Mean of all cells, rounded as printed."""
        return round(float(np.mean(list(self.columns.values()))), 2)

    def column_average(self, key: str) -> float:
        """Mean of one column, rounded as printed."""
        return round(float(np.mean(self.columns[key])), 2)


class Publication(msgspec.Struct, frozen=True):
    """What `published.json` has.

    Attributes:
        tables: 1 and 3 are the "feature extraction percentage", by number of targets; 2 and 4 the "target
            tracking error", by number of experiments.
        figure_3: its text says "up to 80%, while that of traditional method is only 65%".
    """

    tables: tuple[PublishedTable, PublishedTable, PublishedTable, PublishedTable]
    figure_3: dict[str, float]


_PUBLISHED = msgspec.json.decode(files(__package__).joinpath("published.json").read_bytes(), type=Publication)
TABLE_1, TABLE_2, TABLE_3, TABLE_4 = _PUBLISHED.tables
FIGURE_3 = _PUBLISHED.figure_3
TARGETS, RUNS = TABLE_1.rows, TABLE_2.rows
PERCENTAGES, ERRORS = (TABLE_1, TABLE_3), (TABLE_2, TABLE_4)
