"""HOTA on cases worked out by hand."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_tracks.evaluation.scores import Labelled, score_hota

Frames = Callable[..., list[Labelled]]


def test_tracks_that_are_the_truth_are_perfect(frames: Frames):
    """Whatever the ids are."""
    scores = score_hota(frames({1: 0, 2: 50}, {1: 2}), frames({7: 0, 9: 50}, {7: 2}))
    assert (scores.hota, scores.detection_accuracy, scores.association_accuracy) == (1.0, 1.0, 1.0)


def test_a_changed_id_costs_association_only(frames: Frames):
    """Two ids of two frames each for one truth of four: each match shares 2 of 4 frames."""
    scores = score_hota(frames(*[{1: 0}] * 4), frames({5: 0}, {5: 0}, {6: 0}, {6: 0}))
    assert scores.detection_accuracy == 1.0
    assert scores.association_accuracy == pytest.approx(0.5)
    assert scores.hota == pytest.approx(np.sqrt(0.5))


def test_a_miss_costs_both(frames: Frames):
    """One of two frames: half of the boxes, and half of the identity."""
    scores = score_hota(frames({1: 0}, {1: 0}), frames({5: 0}, {}))
    assert (scores.detection_accuracy, scores.association_accuracy) == (0.5, 0.5)


def test_the_overlap_counts_by_thresholds(frames: Frames):
    """Boxes shifted by 4 of 10 px overlap by 6 / 14 = 0.43: found at 8 of 19 thresholds."""
    scores = score_hota(frames({1: 0}), frames({1: 4}))
    assert scores.detection_accuracy == pytest.approx(8 / 19)


@pytest.mark.parametrize(("truth", "tracks"), [({}, {}), ({1: 0}, {}), ({}, {1: 0})])
def test_nothing_found_scores_nothing(frames: Frames, truth: dict[int, float], tracks: dict[int, float]):
    """No division by zero."""
    assert score_hota(frames(truth), frames(tracks)).hota == 0.0


ROWS = st.lists(st.dictionaries(st.integers(1, 4), st.integers(0, 40).map(float)), min_size=1, max_size=6)


@given(ROWS, ROWS)
def test_scores_lie_between_0_and_1_and_do_not_depend_on_numbers(
    frames: Frames, truth: list[dict[int, float]], tracks: list[dict[int, float]]
):
    """Renumbering the tracks changes nothing."""
    length = min(len(truth), len(tracks))
    true, found = frames(*truth[:length]), frames(*tracks[:length])
    scores = score_hota(true, found)
    assert 0.0 <= scores.hota <= 1.0 + 1e-12
    renumbered = [Labelled(100 - frame.ids, frame.boxes) for frame in found]
    again = score_hota(true, renumbered)
    assert again.detection_accuracy == pytest.approx(scores.detection_accuracy)
