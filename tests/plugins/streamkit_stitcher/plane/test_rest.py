"""Whether a camera rests: by how far the best motions of its frames scatter."""

from types import SimpleNamespace

import numpy as np
import pytest

from streamkit_stitcher.plane.rest import RestBelief, RestEvidence


def shown(away, agreement=0.3, near_rest=True):
    """A frame whose best motion is `away` px from rest, with a predicted error of half a pixel."""
    displacements = np.tile([away, 0.0], (4, 1))
    return SimpleNamespace(
        displacements=displacements, corner_std=0.5, agreement=agreement, near_rest=near_rest
    )


def shaken(away, count, **other):
    """Frames that lie so far to one side and the other in turn."""
    return [shown(away if index % 2 else -away, **other) for index in range(count)]


def belief_after(frames):
    """What is believed after some frames."""
    belief = RestBelief()
    for frame in frames:
        belief.learn(frame)
    return belief


@pytest.mark.parametrize(("away", "shakes"), [(0.35, False), (1.0, True)])
def test_a_camera_shakes_whose_frames_scatter_by_more_than_predicted(away, shakes):
    """At rest they do not, and either is known after twenty frames."""
    assert belief_after(shaken(away, 20)).shakes is shakes


def test_a_camera_that_sways_shakes():
    """Once in 25 frames, by little from one frame to the next."""
    assert belief_after(shown(1.2 * np.sin(index / 4)) for index in range(60)).shakes


def test_a_camera_that_has_moved_once_by_less_than_a_pixel_does_not_shake():
    """Its frames lie off by more than they are predicted to, but all alike."""
    belief = belief_after([shown(0.0)] * 5 + [shown(0.9)] * 60)
    assert not belief.shakes
    assert belief.share > 0.9


def test_a_frame_that_movers_bend_is_no_shake():
    """One of twenty-five, however far off, changes nothing."""
    assert not belief_after(shown(20.0 if index % 25 == 24 else 0.2) for index in range(100)).shakes


def test_frames_that_agree_by_chance_or_lie_elsewhere_teach_nothing_about_shaking():
    """The camera may be anywhere in the first, and has moved away in the second."""
    by_chance = belief_after(shaken(5.0, 50, agreement=0.05))
    elsewhere = belief_after(shaken(50.0, 50, near_rest=False))
    assert not by_chance.shakes
    assert not elsewhere.shakes
    assert elsewhere.share < 0.2 < by_chance.share


def test_a_camera_that_comes_to_rest_is_believed_again():
    """After shaking for a hundred frames it is still for two hundred."""
    frames = shaken(1.0, 100) + shaken(0.1, 200)
    assert belief_after(frames[:100]).shakes
    assert not belief_after(frames).shakes


def test_evidence_adds_up():
    """Frames that each say little for the place say much together, and the least sure motion counts."""
    evidence, seen = RestEvidence(), np.array([0.5, *[2.0] * 7])
    doubts = [evidence.add(seen) for _ in range(20)]
    assert doubts == sorted(doubts, reverse=True)
    assert doubts[-1] < 0.1 * doubts[0]
