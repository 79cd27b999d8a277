"""Verification of loop closures."""

from dataclasses import replace

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_stitcher.plane.closure_check import ClosureCheck
from streamkit_stitcher.plane.keyframe_graph import Tie

SHAPE = (360, 640)
PLACES = {index: translation(np.array([220.0 * index, 0.0])) for index in range(30)}


def tie(observer, host, wrong):
    """A tie that is `wrong` px, x y, off the homographies."""
    points = np.random.default_rng(host).uniform(50, 300, (30, 2))
    return Tie(host, observer, np.arange(30), points, points - [220.0 * (observer - host), 0.0] - wrong)


@pytest.fixture
def evidence():
    """A check without waiting ties."""
    return ClosureCheck()


@pytest.mark.parametrize("steps", [{5: 2}, {5: 40}, {}])
def test_a_tie_that_fits_the_homographies_is_accepted_at_once(evidence, steps):
    """3 px off is within what two ties in between allow, and any larger number."""
    own = tie(20, 5, [3.0, 0.0])
    assert evidence.accepted([own], PLACES, steps, SHAPE) == (own,)


def test_a_tie_that_contradicts_a_short_path_is_never_accepted(evidence):
    """Over two ties no error of 200 px accumulates, whatever other ties say: terrain repeats itself."""
    for observer in range(20, 24):
        assert evidence.accepted([tie(observer, 5, [200.0, 0.0])], PLACES, {5: 2}, SHAPE) == ()


def test_a_tie_over_a_long_path_needs_a_second_one_that_agrees(evidence):
    """The first waits; one that contradicts it does not help; with one that agrees both are accepted."""
    first, other, second = tie(20, 5, [200.0, 50.0]), tie(21, 6, [-150.0, 50.0]), tie(21, 4, [205.0, 52.0])
    assert evidence.accepted([first], PLACES, {5: 40}, SHAPE) == ()
    assert evidence.accepted([other], PLACES, {6: 40}, SHAPE) == ()
    assert evidence.accepted([second], PLACES, {}, SHAPE) == (first, second)
    assert evidence.accepted([second], PLACES, {}, SHAPE) == ()


def test_a_correlation_of_a_part_moves_nothing(evidence):
    """Two ties that agree, as in a row of houses, are no evidence where the rest looks different."""
    for observer in (20, 21):
        alike = replace(tie(observer, 5, [200.0, 50.0]), correlation=0.2)
        assert evidence.accepted([alike], PLACES, {5: 40}, SHAPE) == ()


def test_an_old_tie_is_no_evidence(evidence):
    """Ten keyframes later the plane may have moved for other reasons."""
    assert evidence.accepted([tie(10, 5, [200.0, 0.0])], PLACES, {}, SHAPE) == ()
    assert evidence.accepted([tie(20, 6, [200.0, 0.0])], PLACES, {}, SHAPE) == ()


def test_ties_of_forgotten_keyframes_are_left_out(evidence):
    """A long flight forgets its oldest keyframes."""
    assert evidence.accepted([tie(20, 5, [0.0, 0.0])], {20: PLACES[20]}, {}, SHAPE) == ()
