"""Training and test splits: the four partitions of the publication, ten random splits each."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.gallery import Gallery

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
class DatabaseSplit:
    """One random division of a database.

    Attributes:
        training: for learning.
        test: queries, used neither for learning nor for selection.
        seed: of the division.
    """

    training: Gallery
    test: Gallery
    seed: int


def splits(images: NDArray[np.uint8], training: int, count: int = REPETITIONS) -> Iterator[DatabaseSplit]:
    """Random splits of uint8[targets, views, h, w], with `training` views of each target for learning."""
    targets, views = images.shape[:2]
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        order = np.random.default_rng(seed).permuted(np.tile(np.arange(views), (targets, 1)), axis=1)
        chosen = images[np.arange(targets)[:, None], order]
        yield DatabaseSplit(labelled(chosen[:, :training]), labelled(chosen[:, training:]), seed)


def inner_splits(training: Gallery, per_target: int, seed: int, count: int) -> Iterator[DatabaseSplit]:
    """Splits of the training images alone, three quarters of each target's for learning."""
    shape = training.patches.shape[1:]
    images = training.patches.reshape(-1, per_target, *shape)
    kept = min(max(round(0.75 * per_target), 2), per_target - 1)
    for number in range(count):
        generator = np.random.default_rng([seed, INNER_SPLIT, number])
        order = generator.permuted(np.tile(np.arange(per_target), (len(images), 1)), axis=1)
        chosen = images[np.arange(len(images))[:, None], order]
        yield DatabaseSplit(labelled(chosen[:, :kept]), labelled(chosen[:, kept:]), seed)


def first_targets(split: DatabaseSplit, targets: int) -> DatabaseSplit:
    """The split restricted to the first `targets` of its own random order."""
    names = sorted(set(split.training.labels))
    order = np.random.default_rng([split.seed, TARGET_ORDER]).permutation(len(names))
    kept = {names[index] for index in order[:targets]}
    return DatabaseSplit(_only(split.training, kept), _only(split.test, kept), split.seed)


def labelled(images: NDArray[np.uint8]) -> Gallery:
    """The images uint8[targets, views, h, w], labelled by the number of their target."""
    targets, views = images.shape[:2]
    labels = tuple(f"{target + 1:02d}" for target in range(targets) for _ in range(views))
    return Gallery(images.reshape(targets * views, *images.shape[2:]), labels)


def _only(sample: Gallery, kept: set[str]) -> Gallery:
    chosen = [index for index, label in enumerate(sample.labels) if label in kept]
    return Gallery(sample.patches[chosen], tuple(sample.labels[index] for index in chosen))
