"""Which ties across strips are believed."""

from dataclasses import replace

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_stitcher.plane.closure_check import ClosureCheck
from streamkit_stitcher.plane.keyframe_graph import Tie

SHAPE = (360, 640)
PLACES = {index: translation(np.array([220.0 * index, 0.0])) for index in range(30)}


def tie(observer, host, wrong):
    """A tie that is `wrong` px, x y, off what the places tell."""
    points = np.random.default_rng(host).uniform(50, 300, (30, 2))
    return Tie(host, observer, np.arange(30), points, points - [220.0 * (observer - host), 0.0] - wrong)


@pytest.fixture
def evidence():
    """Nothing heard so far."""
    return ClosureCheck()


@pytest.mark.parametrize("steps", [{5: 2}, {5: 40}, {}])
def test_a_tie_that_fits_the_places_is_believed_at_once(evidence, steps):
    """3 px off is what two ties in between let expect, and any number more."""
    own = tie(20, 5, [3.0, 0.0])
    assert evidence.accepted([own], PLACES, steps, SHAPE) == (own,)


def test_a_tie_that_contradicts_the_ties_next_to_it_is_never_believed(evidence):
    """Over two ties nothing adds up to 200 px, whoever else says so: the ground repeats itself."""
    for observer in range(20, 24):
        assert evidence.accepted([tie(observer, 5, [200.0, 0.0])], PLACES, {5: 2}, SHAPE) == ()


def test_a_tie_over_a_long_way_round_needs_a_second_one_that_asks_for_the_same(evidence):
    """The first waits; one that asks for something else is no help; the one that agrees brings it along."""
    first, other, second = tie(20, 5, [200.0, 50.0]), tie(21, 6, [-150.0, 50.0]), tie(21, 4, [205.0, 52.0])
    assert evidence.accepted([first], PLACES, {5: 40}, SHAPE) == ()
    assert evidence.accepted([other], PLACES, {6: 40}, SHAPE) == ()
    assert evidence.accepted([second], PLACES, {}, SHAPE) == (first, second)
    assert evidence.accepted([second], PLACES, {}, SHAPE) == ()


def test_a_likeness_of_a_part_moves_nothing(evidence):
    """Two ties that agree, as in a row of houses, are no evidence where the rest looks different."""
    for observer in (20, 21):
        alike = replace(tie(observer, 5, [200.0, 50.0]), correlation=0.2)
        assert evidence.accepted([alike], PLACES, {5: 40}, SHAPE) == ()


def test_what_was_asked_long_ago_is_no_evidence(evidence):
    """Ten keyframes later the plane may have moved for other reasons."""
    assert evidence.accepted([tie(10, 5, [200.0, 0.0])], PLACES, {}, SHAPE) == ()
    assert evidence.accepted([tie(20, 6, [200.0, 0.0])], PLACES, {}, SHAPE) == ()


def test_ties_of_forgotten_keyframes_are_left_out(evidence):
    """A long flight forgets its oldest keyframes."""
    assert evidence.accepted([tie(20, 5, [0.0, 0.0])], {20: PLACES[20]}, {}, SHAPE) == ()
