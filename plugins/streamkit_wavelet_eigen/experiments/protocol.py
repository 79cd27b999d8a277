"""Training and test splits: the four partitions of the publication, ten random splits each."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

REPETITIONS = 10
FIRST_SEED = 1000
# Independent random streams of a seed: order of targets, and inner splits.
TARGET_ORDER = 77
INNER_SPLIT = 78


@dataclass(frozen=True)
class Partition:
    """One of the four columns of the tables.

    Attributes:
        database: `orl` or `coil20`.
        training: training images of each target; the others are test images.
    """

    database: str
    training: int

    @property
    def key(self) -> str:
        """Name in the results, for example `orl-5train`."""
        return f"{self.database}-{self.training}train"


PARTITIONS = (Partition("orl", 5), Partition("orl", 3), Partition("coil20", 12), Partition("coil20", 9))


@dataclass(frozen=True, eq=False)
class Sample:
    """Labelled images.

    Attributes:
        images: uint8[m, h, w].
        labels: m names.
    """

    images: NDArray[np.uint8]
    labels: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Split:
    """One random division of a database.

    Attributes:
        training: for learning.
        test: queries, used neither for learning nor for selection.
        seed: of the division.
    """

    training: Sample
    test: Sample
    seed: int


def splits(images: NDArray[np.uint8], training: int, count: int = REPETITIONS) -> Iterator[Split]:
    """Random splits of uint8[targets, views, h, w], with `training` views of each target for learning."""
    targets, views = images.shape[:2]
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        order = np.random.default_rng(seed).permuted(np.tile(np.arange(views), (targets, 1)), axis=1)
        chosen = images[np.arange(targets)[:, None], order]
        yield Split(sample_of(chosen[:, :training]), sample_of(chosen[:, training:]), seed)


def inner_splits(training: Sample, per_target: int, seed: int, count: int) -> Iterator[Split]:
    """Splits of the training images alone, three quarters of each target's for learning."""
    shape = training.images.shape[1:]
    images = training.images.reshape(-1, per_target, *shape)
    kept = min(max(round(0.75 * per_target), 2), per_target - 1)
    for number in range(count):
        generator = np.random.default_rng([seed, INNER_SPLIT, number])
        order = generator.permuted(np.tile(np.arange(per_target), (len(images), 1)), axis=1)
        chosen = images[np.arange(len(images))[:, None], order]
        yield Split(sample_of(chosen[:, :kept]), sample_of(chosen[:, kept:]), seed)


def first_targets(split: Split, targets: int) -> Split:
    """The split restricted to the first `targets` of its own random order."""
    names = sorted(set(split.training.labels))
    order = np.random.default_rng([split.seed, TARGET_ORDER]).permutation(len(names))
    kept = {names[index] for index in order[:targets]}
    return Split(_only(split.training, kept), _only(split.test, kept), split.seed)


def sample_of(images: NDArray[np.uint8]) -> Sample:
    """A sample of uint8[targets, views, h, w], labelled by their number."""
    targets, views = images.shape[:2]
    labels = tuple(f"{target + 1:02d}" for target in range(targets) for _ in range(views))
    return Sample(images.reshape(targets * views, *images.shape[2:]), labels)


def _only(sample: Sample, kept: set[str]) -> Sample:
    chosen = [index for index, label in enumerate(sample.labels) if label in kept]
    return Sample(sample.images[chosen], tuple(sample.labels[index] for index in chosen))
