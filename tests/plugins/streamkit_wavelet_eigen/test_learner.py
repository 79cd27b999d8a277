"""The learner is bounded, starts early and numbers its snapshots."""

import numpy as np

from streamkit_wavelet_eigen.feature_space import WaveletEigenSpace
from streamkit_wavelet_eigen.learner import SpaceLearner
from streamkit_wavelet_eigen.preprocessing import Mode, Preprocessing


def _windows(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, 8, 8)).astype(np.float32)


def _learner(batch: int = 6, start: WaveletEigenSpace | None = None) -> SpaceLearner:
    return SpaceLearner(
        patch=8,
        components=3,
        batch=batch,
        forgetting=0.9,
        preprocessing=Preprocessing(Mode.RAW),
        start=start,
    )


def test_first_space_needs_two_windows() -> None:
    """One window has no direction: the space begins with the second."""
    under_test = _learner()
    assert under_test.add(_windows(1)) is None
    space = under_test.add(_windows(1, seed=1))
    assert space is not None
    assert (space.version, space.space.rank) == (1, 1)


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
    assert (space.version, space.space.count) == (1, 6.0)


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
