"""CLEAR MOT and IDF1 on cases worked out by hand."""

from collections.abc import Callable

import numpy as np
import pytest

from streamkit_tracks.evaluation.scores import Labelled, score_identities

Frames = Callable[..., list[Labelled]]


def test_tracks_that_are_the_truth_are_perfect(frames: Frames):
    """No error, whatever the numbers of the tracks."""
    truth = frames({1: 0, 2: 50}, {1: 2, 2: 52})
    scores = score_identities(truth, frames({7: 0, 9: 50}, {7: 2, 9: 52}))
    assert (scores.mota, scores.idf1, scores.overlap) == (1.0, 1.0, 1.0)


def test_every_kind_of_error_counts_once(frames: Frames):
    """One miss and one false alarm in four truths: MOTA 0.5; three of four are right: 0.75."""
    truth = frames({1: 0, 2: 50}, {1: 0, 2: 50})
    scores = score_identities(truth, frames({1: 0, 2: 50}, {1: 0, 3: 90}))
    assert (scores.misses, scores.false_alarms, scores.switches) == (1, 1, 0)
    assert scores.mota == 0.5
    assert scores.idf1 == 0.75


def test_a_changed_id_is_one_switch_and_half_the_identity(frames: Frames):
    """Four frames, the id changes after two: one switch, and one identity explains only two of four."""
    scores = score_identities(frames(*[{1: 0}] * 4), frames({5: 0}, {5: 0}, {6: 0}, {6: 0}))
    assert scores.switches == 1
    assert scores.mota == 0.75
    assert scores.idf1 == 0.5


def test_a_gap_does_not_hide_a_switch(frames: Frames):
    """The id before a gap is remembered."""
    scores = score_identities(frames(*[{1: 0}] * 3), frames({5: 0}, {}, {6: 0}))
    assert (scores.misses, scores.switches) == (1, 1)


def test_a_match_is_kept_while_it_can_be(frames: Frames):
    """A better overlap with another track does not break a match that still holds."""
    scores = score_identities(frames({1: 0}, {1: 0}), frames({5: 0}, {5: 3, 6: 1}))
    assert (scores.switches, scores.false_alarms) == (0, 1)


def test_the_least_overlap_decides(frames: Frames):
    """Boxes shifted by 4 of 10 px overlap by 6 / 14."""
    truth, tracks = frames({1: 0}), frames({1: 4})
    assert score_identities(truth, tracks).mota == -1.0
    assert score_identities(truth, tracks, 0.4).overlap == pytest.approx(6 / 14)


def test_nothing_against_nothing_has_no_score(frames: Frames):
    """NaN, and no division by zero."""
    scores = score_identities(frames({}), frames({}))
    assert np.isnan(scores.mota)
    assert np.isnan(scores.idf1)


def test_different_lengths_are_refused(frames: Frames):
    """A track file of another sequence must not pass unseen."""
    with pytest.raises(ValueError, match=r"truth has 1 frames and the tracks have 2"):
        score_identities(frames({1: 0}), frames({1: 0}, {1: 0}))
