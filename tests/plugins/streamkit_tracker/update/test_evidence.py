"""When a target counts as seen, and when its template may learn."""

import numpy as np
import pytest

from streamkit_tracker.appearance.correlation_filter import Response
from streamkit_tracker.update.evidence import Evidence


def response(peak: float, sharpness: float) -> Response:
    """A response of a filter."""
    return Response(np.array([0.0, 0.0, 40.0, 20.0, 0.0]), peak, sharpness)


def settled(distance: float, peak: float) -> Evidence:
    """Twenty frames of one kind."""
    evidence = Evidence(lost_threshold=0.6, update_threshold=0.85)
    for _ in range(20):
        evidence.judge(distance, response(peak, 30.0), informative=True)
    return evidence


def wavering() -> Evidence:
    """Twenty frames of a target whose responses go up and down by a factor of three."""
    evidence = Evidence(lost_threshold=0.6, update_threshold=0.85)
    for frame in range(20):
        evidence.judge(0.02, response(0.9, 30.0) if frame % 2 else response(0.5, 18.0), informative=True)
    return evidence


@pytest.mark.parametrize(
    ("peak", "sharpness", "seen"), [(0.9, 30.0, True), (0.5, 15.0, True), (0.2, 12.0, False)]
)
def test_a_response_is_believed_unless_it_is_an_outlier(peak: float, sharpness: float, seen: bool):
    """A ninth of the usual height and sharpness together is something else, whatever the usual is."""
    assert settled(0.02, 0.9).is_credible(response(peak, sharpness)) is seen
    assert settled(0.02, 0.3).is_credible(response(peak / 3, sharpness)) is seen


def test_a_target_that_wavers_is_believed_longer():
    """A faint response hides a steady target, not one that often responds faintly."""
    assert wavering().is_credible(response(0.25, 9.0))
    assert not settled(0.02, 0.7).is_credible(response(0.2, 9.0))


def test_a_peak_without_height_above_the_rest_is_none():
    """However high, a response that its surroundings reach as well says nothing."""
    assert not settled(0.02, 0.9).is_credible(response(1.0, 4.0))


def test_what_is_seen_half_is_not_learnt():
    """Half the height and sharpness do to be seen by, not to learn from; no cover soon becomes usual."""
    evidence = settled(0.02, 0.9)
    for _ in range(10):
        assert evidence.is_credible(response(0.5, 16.0))
        verdict = evidence.judge(0.1, response(0.45, 14.0), informative=True)
        assert verdict.seen
        assert not verdict.learnt


def test_a_soft_target_may_fade_further():
    """What hides a rigid target is a new posture of a soft one: seen, and learnt unless it is very faint."""
    soft, rigid = settled(0.5, 0.9), settled(0.02, 0.9)
    assert soft.is_credible(response(0.25, 9.0))
    assert not rigid.is_credible(response(0.25, 9.0))
    assert soft.is_clear(response(0.4, 12.0))
    assert not rigid.is_clear(response(0.4, 12.0))


def test_tolerance_is_that_of_the_target():
    """1 for a rigid target; the ratio of its usual distance to the rigid one's beyond."""
    assert settled(0.02, 0.9).tolerance == 1.0
    assert settled(0.5, 0.6).tolerance == pytest.approx(10.0)


def test_only_what_was_seen_is_remembered():
    """Frames without the target change no gate."""
    evidence = settled(0.02, 0.9)
    for _ in range(40):
        verdict = evidence.judge(1.5, None, informative=True)
        assert not verdict.seen
        assert not verdict.learnt
    assert evidence.tolerance == 1.0
    assert evidence.is_credible(response(0.6, 20.0))
    assert not evidence.is_credible(response(0.2, 12.0))


def test_a_rigid_target_half_covered_is_seen_and_not_learnt():
    """Its distance has left what is learnt from while it still responds: the cover must not be learnt."""
    verdict = settled(0.02, 0.9).judge(0.4, response(0.6, 15.0), informative=True)
    assert verdict.seen
    assert not verdict.learnt


def test_a_soft_target_is_learnt_by_its_response():
    """No distance of a runner is small; a clear response stands for it."""
    verdict = settled(0.7, 0.6).judge(0.8, response(0.5, 15.0), informative=True)
    assert verdict.seen
    assert verdict.learnt


def test_a_picture_that_says_nothing_is_no_evidence():
    """A small distance counts only where other places have larger ones."""
    assert not settled(0.02, 0.9).judge(0.01, None, informative=False).seen


@pytest.mark.parametrize(
    ("peak", "sharpness", "least", "most"),
    [(0.9, 30.0, 1.0, 1.0), (0.5, 12.0, 0.01, 0.5), (0.1, 6.0, 0.0, 0.0)],
)
def test_a_filter_learns_of_what_is_doubted_by_half_at_most(
    peak: float, sharpness: float, least: float, most: float
):
    """All of a clear response, ever less of fainter ones, nothing of what is not believed."""
    verdict = settled(0.02, 0.9).judge(0.02, response(peak, sharpness), informative=True)
    assert least <= verdict.share <= most
