"""Which pictures train and which test: the four partitions of the publication, ten times each."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

REPETITIONS = 10
FIRST_SEED = 1000
# Keeps the order of targets apart from the split that has the same seed.
TARGET_ORDER = 77
INNER_SPLIT = 78


@dataclass(frozen=True)
class Partition:
    """One of the four columns of the tables.

    Attributes:
        database: `orl` or `coil20`.
        training: training pictures of each target; the others test.
    """

    database: str
    training: int

    @property
    def name(self) -> str:
        """As the publication calls it, for example `5train`."""
        return f"{self.training}train"

    @property
    def key(self) -> str:
        """Name in the results, for example `orl-5train`."""
        return f"{self.database}-{self.name}"


PARTITIONS = (Partition("orl", 5), Partition("orl", 3), Partition("coil20", 12), Partition("coil20", 9))


@dataclass(frozen=True, eq=False)
class Sample:
    """Pictures with their targets.

    Attributes:
        pictures: uint8[m, h, w].
        labels: m names.
    """

    pictures: NDArray[np.uint8]
    labels: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Split:
    """One random division of a database.

    Attributes:
        training: what may be learnt from.
        test: what is asked; never seen in learning nor in any choice.
        seed: that made it.
    """

    training: Sample
    test: Sample
    seed: int


def splits(pictures: NDArray[np.uint8], training: int, count: int = REPETITIONS) -> Iterator[Split]:
    """Random splits of uint8[targets, views, h, w], with `training` views of each target to learn from."""
    targets, views = pictures.shape[:2]
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        order = np.random.default_rng(seed).permuted(np.tile(np.arange(views), (targets, 1)), axis=1)
        chosen = pictures[np.arange(targets)[:, None], order]
        yield Split(sample_of(chosen[:, :training]), sample_of(chosen[:, training:]), seed)


def inner_splits(training: Sample, per_target: int, seed: int, count: int) -> Iterator[Split]:
    """Splits of training pictures alone, three quarters of each target's to learn from, for a choice."""
    shape = training.pictures.shape[1:]
    pictures = training.pictures.reshape(-1, per_target, *shape)
    kept = min(max(round(0.75 * per_target), 2), per_target - 1)
    for number in range(count):
        generator = np.random.default_rng([seed, INNER_SPLIT, number])
        order = generator.permuted(np.tile(np.arange(per_target), (len(pictures), 1)), axis=1)
        chosen = pictures[np.arange(len(pictures))[:, None], order]
        yield Split(sample_of(chosen[:, :kept]), sample_of(chosen[:, kept:]), seed)


def first_targets(split: Split, targets: int) -> Split:
    """The same split with only so many targets, the first of a random order that is the split's own."""
    names = sorted(set(split.training.labels))
    order = np.random.default_rng([split.seed, TARGET_ORDER]).permutation(len(names))
    kept = {names[index] for index in order[:targets]}
    return Split(_only(split.training, kept), _only(split.test, kept), split.seed)


def sample_of(pictures: NDArray[np.uint8]) -> Sample:
    """A sample of uint8[targets, views, h, w], targets named by their number."""
    targets, views = pictures.shape[:2]
    labels = tuple(f"{target + 1:02d}" for target in range(targets) for _ in range(views))
    return Sample(pictures.reshape(targets * views, *pictures.shape[2:]), labels)


def _only(sample: Sample, kept: set[str]) -> Sample:
    chosen = [index for index, label in enumerate(sample.labels) if label in kept]
    return Sample(sample.pictures[chosen], tuple(sample.labels[index] for index in chosen))
