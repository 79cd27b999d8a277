"""Checks of ties across flight strips."""

from dataclasses import replace

import numpy as np
import pytest

from streamkit.geometry.homography import translation
from streamkit_stitcher.plane.keyframe_graph import Tie
from streamkit_stitcher.plane.tie_checks import accepted_ties

SHAPE = (360, 640)
PLACES = {index: translation(np.array([220.0 * index, 0.0])) for index in range(30)}


def tie(observer, host, wrong):
    """A tie that is `wrong` px, x y, off the homographies."""
    points = np.random.default_rng(host).uniform(50, 300, (30, 2))
    return Tie(host, observer, np.arange(30), points, points - [220.0 * (observer - host), 0.0] - wrong)


@pytest.mark.parametrize("steps", [{5: 2}, {5: 40}, {}])
def test_a_tie_that_fits_the_homographies_is_accepted(steps):
    """3 px off is within what two ties in between allow, and any larger number."""
    own = tie(20, 5, [3.0, 0.0])
    assert accepted_ties([own], PLACES, steps, SHAPE) == ((own,), True)


def test_a_tie_that_contradicts_a_short_path_is_never_accepted():
    """Over two ties no error of 200 px accumulates: terrain repeats itself."""
    assert accepted_ties([tie(20, 5, [200.0, 0.0])], PLACES, {5: 2}, SHAPE) == ((), False)


def test_a_large_error_over_a_long_path_needs_all_shared_ground_to_agree():
    """Two rows of houses match at a false shift, but what is around them does not."""
    own = tie(20, 5, [200.0, 50.0])
    assert accepted_ties([own], PLACES, {5: 40}, SHAPE) == ((own,), True)
    assert accepted_ties([replace(own, correlation=0.2)], PLACES, {5: 40}, SHAPE) == ((), False)


def test_ties_of_forgotten_keyframes_are_left_out():
    """A long flight forgets its oldest keyframes."""
    assert accepted_ties([tie(20, 5, [0.0, 0.0])], {20: PLACES[20]}, {}, SHAPE) == ((), False)
