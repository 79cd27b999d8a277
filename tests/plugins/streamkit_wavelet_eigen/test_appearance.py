"""A stream's windows are learnt, projected and recognised in one space at a time."""

import numpy as np

from streamkit_wavelet_eigen.appearance import AppearanceModel, AppearanceSettings
from streamkit_wavelet_eigen.gallery import empty_gallery
from streamkit_wavelet_eigen.recipe import Mode, Preprocessing, Recipe
from streamkit_wavelet_eigen.windows import Windows

RECIPE = Recipe(16, Preprocessing(Mode.RAW), components=4)


def _windows(count: int, seed: int = 0, clipped: float = 0.0) -> Windows:
    patches = np.random.default_rng(seed).integers(0, 256, (count, 16, 16)).astype(np.float32)
    return Windows(patches, np.zeros(count, bool), np.full(count, clipped), np.zeros(count, bool))


def _appearance(batch: int = 8) -> AppearanceModel:
    return AppearanceModel(AppearanceSettings(RECIPE, batch, 0.95, 5), None, empty_gallery(16))


def test_no_features_before_a_space() -> None:
    """One window makes no space; the second does."""
    under_test = _appearance()
    assert under_test.process(_windows(1), learn=True, label="") is None
    seen = under_test.process(_windows(1, 1), learn=True, label="")
    assert seen is not None
    projection, matches = seen
    assert matches is None
    assert projection.vectors.shape == (1, 4)


def test_clipped_and_flat_windows_are_neither_learnt_nor_added() -> None:
    """Windows that are clipped by more than a quarter, or are flat, are projected only."""
    under_test = _appearance()
    flat = Windows(np.full((4, 16, 16), 9, np.float32), np.ones(4, bool), np.zeros(4), np.zeros(4, bool))
    for windows in (_windows(4, clipped=0.3), flat):
        assert under_test.process(windows, learn=True, label="car") is None
    assert len(under_test.gallery) == 0
    assert under_test.process(_windows(4, clipped=0.2), learn=True, label="car") is not None
    assert under_test.gallery.labels == ("car",) * 4


def test_known_windows_are_labelled_in_every_version() -> None:
    """When the space moves on, the gallery is embedded again: labels stay right."""
    under_test = _appearance(batch=2)
    first, second = _windows(2), _windows(2, 1)
    under_test.process(first, learn=True, label="car")
    under_test.process(second, learn=True, label="van")
    versions = set()
    for seed in range(2, 8):
        under_test.process(_windows(2, seed), learn=True, label="")
        for windows, name in ((first, "car"), (second, "van")):
            seen = under_test.process(windows, learn=False, label="")
            assert seen is not None
            matches = seen[1]
            assert matches is not None
            assert matches.labels == (name, name)
        assert under_test.learner.space is not None
        versions.add(under_test.learner.space.version)
    assert len(versions) == 6


def test_learning_can_be_paused() -> None:
    """Without `learn` the space is the same object, whatever is processed."""
    under_test = _appearance(batch=2)
    under_test.process(_windows(4), learn=True, label="")
    space = under_test.learner.space
    for seed in range(5):
        under_test.process(_windows(9, seed), learn=False, label="")
    assert under_test.learner.space is space
