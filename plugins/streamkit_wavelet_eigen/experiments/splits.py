"""The two image databases of the publication, and its four partitions into training and test images."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.gallery import Gallery, read_window

VARIABLE = "STREAMKIT_DATA"
SIDE = 64
# Training images of each target in the columns of the tables, by database.
PARTITIONS = {
    "orl-5train": ("orl", 5),
    "orl-3train": ("orl", 3),
    "coil20-12train": ("coil20", 12),
    "coil20-9train": ("coil20", 9),
}
REPETITIONS = 10
FIRST_SEED = 1000
# Independent random streams of a seed: order of targets, and inner splits.
TARGET_ORDER, INNER_SPLIT = 77, 78


class MissingData(FileNotFoundError):
    """The databases are missing or incomplete."""


def data_folder(given: Path | None = None) -> Path:
    """The folder with `orl/` and `coil20/`: the given one or STREAMKIT_DATA, or `data` in it.

    Raises:
        MissingData: neither has them.
    """
    place = given or (Path(os.environ[VARIABLE]) if os.environ.get(VARIABLE) else None)
    if place is None:
        raise MissingData(f"experiments need the databases: name their folder with --data or set {VARIABLE}")
    for folder in (place, place / "data"):
        if (folder / "orl").is_dir() and (folder / "coil20").is_dir():
            return folder
    raise MissingData(
        f"{place}: there must be folders orl (sN/M.pgm) and coil20 (objN__K.png) in it; neither database may "
        "be shipped with this program, see docs/paper-tables.md for their origin"
    )


def read_orl(folder: Path) -> NDArray[np.uint8]:
    """The ORL faces, uint8[40, 10, 64, 64]: 40 people, 10 images each, scaled from 92x112 by area."""
    return _read([[folder / f"orl/s{person}/{view}.pgm" for view in range(1, 11)] for person in range(1, 41)])


def read_coil20(folder: Path) -> NDArray[np.uint8]:
    """COIL-20, uint8[20, 24, 64, 64]: 20 objects, views 15 degrees apart, scaled from 128x128 by area."""
    found: dict[int, dict[int, Path]] = {}
    for path in (folder / "coil20").iterdir():
        if match := re.fullmatch(r"obj(\d+)__(\d+)\.png", path.name):
            found.setdefault(int(match[1]), {})[int(match[2])] = path
    if len(found) != 20 or any(len(views) != 24 for views in found.values()):
        raise MissingData(f"{folder / 'coil20'}: there must be 20 objects with 24 views each, objN__K.png")
    return _read([[views[number] for number in sorted(views)] for _, views in sorted(found.items())])


def _read(paths: list[list[Path]]) -> NDArray[np.uint8]:
    images = []
    for path in (path for views in paths for path in views):
        try:
            images.append(read_window(path, SIDE))
        except (OSError, ValueError):
            raise MissingData(f"{path}: the database is not whole; this image cannot be read") from None
    return np.stack(images).reshape(len(paths), -1, SIDE, SIDE)


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
    for seed in range(FIRST_SEED, FIRST_SEED + count):
        yield _divided(images, training, seed, np.random.default_rng(seed))


def inner_splits(training: Gallery, per_target: int, seed: int, count: int) -> Iterator[DatabaseSplit]:
    """Splits of the training images alone, three quarters of each target's for learning."""
    images = training.patches.reshape(-1, per_target, *training.patches.shape[1:])
    kept = min(max(round(0.75 * per_target), 2), per_target - 1)
    for number in range(count):
        yield _divided(images, kept, seed, np.random.default_rng([seed, INNER_SPLIT, number]))


def _divided(
    images: NDArray[np.uint8], training: int, seed: int, generator: np.random.Generator
) -> DatabaseSplit:
    """The views of each target in a random order, the first for learning."""
    targets, views = images.shape[:2]
    order = generator.permuted(np.tile(np.arange(views), (targets, 1)), axis=1)
    chosen = images[np.arange(targets)[:, None], order]
    return DatabaseSplit(_labelled(chosen[:, :training]), _labelled(chosen[:, training:]), seed)


def _labelled(images: NDArray[np.uint8]) -> Gallery:
    """The images uint8[targets, views, h, w], labelled by the number of their target."""
    targets, views = images.shape[:2]
    labels = tuple(f"{target + 1:02d}" for target in range(targets) for _ in range(views))
    return Gallery(images.reshape(targets * views, *images.shape[2:]), labels)


def first_targets(split: DatabaseSplit, targets: int) -> DatabaseSplit:
    """The split restricted to the first `targets` of its own random order."""
    names = sorted(set(split.training.labels))
    order = np.random.default_rng([split.seed, TARGET_ORDER]).permutation(len(names))
    kept = {names[index] for index in order[:targets]}
    training, test = (
        part.only([label in kept for label in part.labels]) for part in (split.training, split.test)
    )
    return DatabaseSplit(training, test, split.seed)
