"""Tables 2 and 4: scenes with exact truth, followed by the real elements."""

import itertools
from pathlib import Path

import numpy as np

from streamkit_wavelet_eigen.experiments.command import follow_target
from streamkit_wavelet_eigen.experiments.splits import data_folder, read_coil20, splits
from streamkit_wavelet_eigen.experiments.tracking import (
    FRAMES,
    TARGET_SIDE,
    by_runs,
    make_scene,
    tracking_errors,
)


def _images(count: int = 3) -> np.ndarray:
    return np.stack([np.full((64, 64), 80 * number + 40, np.uint8) for number in range(count)])


def test_targets_lie_where_the_truth_says() -> None:
    """Around each true centre is the image of that frame, within the noise."""
    scene = make_scene(_images(), 7)
    for index, (frame, (x, y)) in enumerate(zip(scene.frames, scene.centres, strict=True)):
        left, top = round(x - (TARGET_SIDE - 1) / 2), round(y - (TARGET_SIDE - 1) / 2)
        window = frame[top : top + TARGET_SIDE, left : left + TARGET_SIDE].astype(float)
        assert window.shape == (TARGET_SIDE, TARGET_SIDE)
        assert abs(window.mean() - (80 * (index * 3 // FRAMES) + 40)) < 1
        assert 2.0 < window.std() < 4.0


def test_target_and_ground_move() -> None:
    """No frame repeats the one before, neither at the target nor at the border."""
    scene = make_scene(_images(1), 3)
    steps = np.linalg.norm(np.diff(scene.centres, axis=0), axis=1)
    assert 0.5 < steps.mean() < 6.0
    border = scene.frames[:, :20].astype(float)
    assert all(np.abs(one - other).mean() > 5 for one, other in itertools.pairwise(border))


def test_the_same_seed_is_the_same_scene() -> None:
    """Every byte."""
    np.testing.assert_array_equal(make_scene(_images(), 5).frames, make_scene(_images(), 5).frames)
    assert (make_scene(_images(), 5).frames != make_scene(_images(), 6).frames).any()


def test_the_tracker_follows_and_repeats(shared_folder: Path) -> None:
    """With a space learnt from training images the target is followed, twice alike."""
    parts = list(splits(read_coil20(data_folder(shared_folder)), 12, 2))
    one, again = (tracking_errors(parts, follow_target, 2) for _ in range(2))
    assert one == again
    assert max(one) < TARGET_SIDE / 3


def test_rows_average_the_first_runs() -> None:
    """Row n is the mean of the first n runs; rows beyond the runs are left out."""
    rows = by_runs([1.0] * 10 + [2.0] * 10)
    assert [(row["mean"], row["n"]) for row in rows] == [(1.0, 10), (1.5, 20)]
