"""Whether a camera rests: by how far the best motions of its frames scatter."""

from types import SimpleNamespace

import numpy as np
import pytest

from streamkit_stitcher.plane.rest import RestBelief, RestEvidence


def shown(away, agreement=0.3, near_rest=True):
    """A frame whose best motion is `away` px from rest, with a predicted error of half a pixel."""
    return SimpleNamespace(away=away, corner_std=0.5, agreement=agreement, near_rest=near_rest)


def belief_after(frames):
    """What is believed after some frames."""
    belief = RestBelief()
    for frame in frames:
        belief.learn(frame)
    return belief


@pytest.mark.parametrize(("away", "shakes"), [(0.35, False), (1.0, True)])
def test_a_camera_shakes_whose_frames_lie_farther_from_rest_than_predicted(away, shakes):
    """At rest they do not, and either is known after twenty frames."""
    assert belief_after(shown(away) for _ in range(20)).shakes is shakes


def test_a_frame_that_movers_bend_is_no_shake():
    """One of twenty, however far off, changes nothing."""
    assert not belief_after(shown(20.0 if index % 20 == 19 else 0.2) for index in range(100)).shakes


def test_frames_that_agree_by_chance_or_lie_elsewhere_teach_nothing_about_shaking():
    """The camera may be anywhere in the first, and has moved away in the second."""
    by_chance = belief_after(shown(5.0, agreement=0.05) for _ in range(50))
    elsewhere = belief_after(shown(50.0, near_rest=False) for _ in range(50))
    assert not by_chance.shakes
    assert not elsewhere.shakes
    assert elsewhere.share < 0.2 < by_chance.share


def test_a_camera_that_comes_to_rest_is_believed_again():
    """After shaking for a hundred frames it is still for two hundred."""
    frames = [shown(1.0) for _ in range(100)] + [shown(0.1) for _ in range(200)]
    assert belief_after(frames[:100]).shakes
    assert not belief_after(frames).shakes


def test_evidence_adds_up():
    """Frames that each say little for the place say much together, and the least sure motion counts."""
    evidence, seen = RestEvidence(), np.array([0.5, *[2.0] * 7])
    doubts = [evidence.add(seen) for _ in range(20)]
    assert doubts == sorted(doubts, reverse=True)
    assert doubts[-1] < 0.1 * doubts[0]
