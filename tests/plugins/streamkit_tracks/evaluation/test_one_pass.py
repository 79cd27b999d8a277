"""Success and precision of one target."""

import numpy as np
import pytest

from streamkit_tracks.evaluation.scores import one_pass

TRUTH = np.tile([10.0, 10, 20, 20], (4, 1))


def test_the_truth_itself_is_nearly_one():
    """No overlap is more than 1, so that 20 of 21 thresholds are passed."""
    scores = one_pass(TRUTH, TRUTH)
    assert scores.success == pytest.approx(20 / 21)
    assert (scores.precision, scores.centre_error, scores.frames) == (1.0, 0.0, 4)


def test_frames_without_truth_do_not_count():
    """NaN or no area: nothing is known, whatever the tracker said."""
    truth = TRUTH.copy()
    truth[1], truth[2, 2] = np.nan, 0
    found = TRUTH.copy()
    found[1:3] += 100
    assert one_pass(found, truth).frames == 2
    assert one_pass(found, truth).precision == 1.0


def test_frames_without_a_box_are_failures():
    """A tracker that gives up gains nothing by it."""
    found = TRUTH.copy()
    found[2:] = np.nan
    scores = one_pass(found, TRUTH)
    assert scores.success == pytest.approx(10 / 21)
    assert scores.precision == 0.5


def test_twenty_pixels_are_precise_and_more_are_not():
    """The bound belongs to it."""
    found = TRUTH + np.array([[20.0, 0, 0, 0], [20.5, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]])
    assert one_pass(found, TRUTH).precision == 0.75


def test_what_cannot_be_scored_is_refused():
    """Lengths that differ, and truths that are all missing."""
    with pytest.raises(ValueError, match="3 boxes for 4"):
        one_pass(TRUTH[:3], TRUTH)
    with pytest.raises(ValueError, match="no frame has a truth"):
        one_pass(TRUTH, np.full((4, 4), np.nan))
