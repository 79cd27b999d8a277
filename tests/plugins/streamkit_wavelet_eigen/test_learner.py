"""A batch becomes a space; the stream learner is bounded, starts early and numbers its snapshots."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy

from streamkit_wavelet_eigen.appearance import AppearanceSettings, SpaceLearner
from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace, learn_space
from streamkit_wavelet_eigen.recipe import Basis, Mode, Preprocessing, Recipe, Views

RECIPE = Recipe(8, Preprocessing(Mode.RAW), components=3)


def _windows(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, 8, 8)).astype(np.float32)


def _learner(batch: int = 6, start: WaveletEigenSpace | None = None) -> SpaceLearner:
    return SpaceLearner(AppearanceSettings(RECIPE, batch=batch, forgetting=0.9), start)


def test_first_space_needs_two_windows() -> None:
    """One window has no direction: the space begins with the second."""
    under_test = _learner()
    assert under_test.add(_windows(1)) is None
    space = under_test.add(_windows(1, seed=1))
    assert space is not None
    assert (space.version, space.rank) == (1, 1)


def test_version_rises_with_each_full_batch() -> None:
    """After the first space, `batch` windows make the next version; fewer leave it."""
    under_test = _learner(batch=6)
    first = under_test.add(_windows(2))
    assert under_test.add(_windows(5, seed=1)) is first
    second = under_test.add(_windows(1, seed=2))
    assert second is not None
    assert second.version == 2
    assert first is not None
    assert first.version == 1


def test_a_crowded_frame_counts_for_one_batch() -> None:
    """Of 1000 windows in one call only `batch` are learnt, so cost and memory stay bounded."""
    under_test = _learner(batch=6)
    space = under_test.add(_windows(1000))
    assert space is not None
    assert (space.version, space.spaces[0].count) == (1, 6.0)


def test_no_window_changes_nothing() -> None:
    """A frame without detections leaves the space as it is."""
    under_test = _learner()
    assert under_test.add(_windows(0)) is None
    space = under_test.add(_windows(2))
    assert under_test.add(_windows(0)) is space


def test_learning_goes_on_from_a_given_space() -> None:
    """A loaded space is there at once and keeps counting versions."""
    start = _learner().add(_windows(4))
    under_test = _learner(batch=6, start=start)
    assert under_test.space is start
    space = under_test.add(_windows(6, seed=5))
    assert space is not None
    assert space.version == 2


@pytest.mark.parametrize("basis", list(Basis))
def test_blocks_are_learnt_from_a_stream(basis: Basis) -> None:
    """Updates in batches reach the space that one batch of everything gives, in each block."""
    recipe = replace(RECIPE, blocks=2, basis=basis, components=16)
    under_test = SpaceLearner(AppearanceSettings(recipe, batch=10, forgetting=1.0))
    windows = _windows(42)
    under_test.add(windows[:2])
    for first in range(2, 42, 10):
        under_test.add(windows[first : first + 10])
    space, whole = under_test.space, learn_space(windows, recipe)
    assert space is not None
    assert len(space.spaces) == (4 if basis is Basis.PER_BLOCK else 1)
    for ours, theirs in zip(space.spaces, whole.spaces, strict=True):
        np.testing.assert_allclose(ours.mean, theirs.mean, atol=1e-6)
        np.testing.assert_allclose(ours.singular_values, theirs.singular_values, rtol=1e-6)


def test_flat_windows_are_not_learnt() -> None:
    """A window without structure is not learnt; only flat ones are an error."""
    windows = np.concatenate([_windows(6), np.full((3, 8, 8), 90.0, np.float32)])
    learnt = learn_space(windows, RECIPE).spaces[0]
    np.testing.assert_allclose(learnt.mean, learn_space(_windows(6), RECIPE).spaces[0].mean)
    with pytest.raises(ValueError, match="all of them flat"):
        learn_space(windows[6:], RECIPE)


def test_one_window_is_a_mean_without_directions() -> None:
    """A space of a single window embeds everything as zeros."""
    space = learn_space(_windows(1), RECIPE)
    assert space.rank == 0
    assert (space.embed(_windows(3, seed=4)) == 0).all()


def test_views_join_the_batch() -> None:
    """Each window counts with its virtual views."""
    space = learn_space(_windows(5), replace(RECIPE, views=Views.MIRRORED))
    assert space.spaces[0].count == 5 * 18


def test_too_many_values_are_refused() -> None:
    """More than fits the memory set aside is refused before it is prepared."""
    few = np.broadcast_to(_windows(1, seed=2), (70_000, 8, 8))
    with pytest.raises(ValueError, match="fewer windows"):
        learn_space(few, replace(RECIPE, views=Views.MIRRORED))


def test_a_fisher_step_needs_a_label_for_each_window() -> None:
    """Missing labels, and labels all alike, are refused with the counts."""
    recipe = replace(RECIPE, discriminative=True)
    with pytest.raises(ValueError, match="got 6 windows and 2 labels"):
        learn_space(_windows(6), recipe, ["a", "b"])
    with pytest.raises(ValueError, match="at least two labels"):
        learn_space(_windows(6), recipe, ["a"] * 6)


@pytest.mark.parametrize("name", ["orl", "coil20"])
def test_a_stream_follows_the_batch(streamkit_data: Path, name: str) -> None:
    """After 200 images, 5 at a time, the first 8 principal angles to the batch are at most 5 degrees."""
    images = _images(sorted((streamkit_data / name).rglob("*.p[gn][mg]")))
    recipe = Recipe(32, Preprocessing(Mode.RAW), components=16)
    for seed in range(3):
        chosen = np.random.default_rng(seed).permutation(images)[:200]
        under_test = SpaceLearner(AppearanceSettings(recipe, batch=5, forgetting=1.0))
        under_test.add(chosen[:5])
        for first in range(5, 200, 5):
            under_test.add(chosen[first : first + 5])
        assert under_test.space is not None
        ours, theirs = under_test.space.spaces[0], learn_space(chosen, recipe).spaces[0]
        assert ours.rank == 16
        assert np.degrees(scipy.linalg.subspace_angles(ours.basis[:8].T, theirs.basis[:8].T)).max() <= 5.0


def _images(paths: list[Path]) -> np.ndarray:
    assert len(paths) >= 200
    read = (cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths)
    return np.stack([cv2.resize(one, (32, 32), interpolation=cv2.INTER_AREA) for one in read]).astype(
        np.float32
    )
