"""When a target counts as seen, and when its template may learn."""

import pytest

from streamkit_tracker.evidence import Evidence


def settled(distance: float, peak: float) -> Evidence:
    """Twenty frames of one kind."""
    evidence = Evidence(lost_threshold=0.6, update_threshold=0.85)
    for _ in range(20):
        evidence.judge(distance, (peak, 30.0), informative=True, unseen=False)
    return evidence


@pytest.mark.parametrize(("peak", "seen"), [(0.9, True), (0.4, True), (0.2, False)])
def test_a_response_is_high_when_it_is_usual(peak: float, seen: bool):
    """A third of the usual height is enough, whatever that height is."""
    assert settled(0.02, 0.9).responds(peak, 7.0, unseen=False) is seen
    assert settled(0.02, 0.9 / 3).responds(peak / 3, 7.0, unseen=False) is seen


def test_after_a_gap_more_is_asked():
    """What would do from frame to frame does not do to find a target again."""
    evidence = settled(0.02, 0.9)
    assert evidence.responds(0.4, 7.0, unseen=False)
    assert not evidence.responds(0.4, 7.0, unseen=True)
    assert evidence.responds(0.6, 7.0, unseen=True)


def test_a_peak_without_height_above_the_rest_is_none():
    """However high, a response that its surroundings reach as well says nothing."""
    assert not settled(0.02, 0.9).responds(1.0, 4.0, unseen=False)


def test_a_soft_target_is_believed_at_a_fainter_peak():
    """A runner far from its template keeps responding faintly; a car does so only when it is gone."""
    assert settled(0.7, 0.6).responds(0.1, 6.0, unseen=False)
    assert not settled(0.02, 0.6).responds(0.1, 6.0, unseen=False)


def test_tolerance_is_that_of_the_target():
    """1 for a rigid target; the ratio of its usual distance to the rigid one's beyond."""
    assert settled(0.02, 0.9).tolerance == 1.0
    assert settled(0.5, 0.6).tolerance == pytest.approx(10.0)


def test_only_what_was_seen_is_remembered():
    """Frames without the target change no gate."""
    evidence = settled(0.02, 0.9)
    for _ in range(40):
        verdict = evidence.judge(1.5, None, informative=True, unseen=True)
        assert not verdict.seen
        assert not verdict.learnt
    assert evidence.tolerance == 1.0
    assert evidence.usual_peak == 0.9


def test_a_rigid_target_half_covered_is_seen_and_not_learnt():
    """Its distance has left what is learnt from while it still responds: the cover must not be learnt."""
    verdict = settled(0.02, 0.9).judge(0.4, (0.6, 15.0), informative=True, unseen=False)
    assert verdict.seen
    assert not verdict.learnt


def test_a_soft_target_is_learnt_by_its_response():
    """No distance of a runner is small; a clear response stands for it."""
    verdict = settled(0.7, 0.6).judge(0.8, (0.5, 15.0), informative=True, unseen=False)
    assert verdict.seen
    assert verdict.learnt


def test_a_picture_that_says_nothing_is_no_evidence():
    """A small distance counts only where other places have larger ones."""
    assert not settled(0.02, 0.9).judge(0.01, None, informative=False, unseen=False).seen
