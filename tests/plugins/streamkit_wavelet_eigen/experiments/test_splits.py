"""Splits have the published sizes, are the same every time, and never mix training with test."""

import numpy as np
import pytest

from streamkit_wavelet_eigen.experiments.splits import PARTITIONS, first_targets, inner_splits, splits


def _numbered(targets: int, views: int) -> np.ndarray:
    """Images that are their own number."""
    numbers = np.arange(targets * views).reshape(targets, views, 1, 1)
    return np.broadcast_to(numbers, (targets, views, 2, 2)).astype(np.uint16)


@pytest.mark.parametrize(
    ("targets", "views", "training", "sizes"),
    [(40, 10, 5, (200, 200)), (40, 10, 3, (120, 280)), (20, 24, 12, (240, 240)), (20, 24, 9, (180, 300))],
)
def test_sizes_and_balance(targets: int, views: int, training: int, sizes: tuple[int, int]) -> None:
    """Each target has its share in both parts, every image is in exactly one of them."""
    found = list(splits(_numbered(targets, views), training))
    assert len(found) == 10
    for split in found:
        assert (len(split.training.labels), len(split.test.labels)) == sizes
        known, asked = (set(part.patches[:, 0, 0].tolist()) for part in (split.training, split.test))
        assert not known & asked
        assert len(known | asked) == targets * views
        for part in (split.training, split.test):
            names = [f"{number // views + 1:02d}" for number in part.patches[:, 0, 0].tolist()]
            assert list(part.labels) == names


def test_splits_differ_and_repeat() -> None:
    """Ten different divisions, the same ones in every run."""
    one, again = (
        [tuple(split.training.patches[:, 0, 0]) for split in splits(_numbered(4, 10), 5)] for _ in "ab"
    )
    assert one == again
    assert len(set(one)) == 10


def test_selection_uses_training_images_only() -> None:
    """Inner splits divide the training images of a split; its test images are in none of them."""
    for split in splits(_numbered(4, 10), 5, 3):
        training = set(split.training.patches[:, 0, 0].tolist())
        for inner in inner_splits(split.training, 5, split.seed, 3):
            known, asked = (set(part.patches[:, 0, 0].tolist()) for part in (inner.training, inner.test))
            assert known | asked == training
            assert not known & asked
            assert len(known) == 16


def test_fewer_targets_are_the_first_of_more() -> None:
    """A gallery of k targets is that of k + 1 without one, in both parts."""
    split = next(splits(_numbered(12, 10), 5))
    before: set[str] = set()
    for count in range(1, 11):
        part = first_targets(split, count)
        names = set(part.training.labels)
        assert names == set(part.test.labels)
        assert len(names) == count
        assert before < names
        before = names


def test_the_four_partitions_are_the_published_ones() -> None:
    """In the order of the tables."""
    assert list(PARTITIONS) == [
        "orl-5train", "orl-3train", "coil20-12train", "coil20-9train",
    ]  # fmt: skip
