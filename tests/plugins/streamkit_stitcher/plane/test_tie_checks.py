"""Checks of ties across flight strips."""

from dataclasses import replace

import numpy as np
import pytest

from streamkit.geometry.homography import project, translation
from streamkit_stitcher.plane.keyframe_graph import KeyframeGraph, Tie
from streamkit_stitcher.plane.tie_checks import accepted_ties, joins

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


def met_planes(tilt):
    """Two planes of three keyframes each, of which the last frame of one shows the ground of the other.

    Along the height of the frame the depth grows by the part `tilt`.
    """
    graph = KeyframeGraph(max_tied=100)
    for index in range(6):
        graph.add(index, translation(np.array([20.0 * index, 0.0])), [], plane=index // 3)
    points = np.random.default_rng(1).uniform([50, 50], [600, 300], (60, 2))
    to_plane = graph.homographies[5]
    turned = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, tilt / SHAPE[0], 1.0]])
    return graph, Tie(0, 5, np.arange(60), project(turned @ to_plane, points), points)


@pytest.mark.parametrize("tilt", [0.0, 0.05, 0.2])
def test_planes_of_a_video_are_joined_to_within_two_pixels(tilt):
    """Where they differ in tilt a similarity would put the frames of one tens of pixels off."""
    graph, tie = met_planes(tilt)
    ((change, moved, kept),) = joins([tie], graph, 1, SHAPE, is_survey=False)
    assert (moved, kept) == (0, 1)
    places = project(change @ graph.homographies[0], tie.host_points)
    assert np.abs(places - project(graph.homographies[5], tie.points)).max() < 2.0
    assert graph.hosts(5) == {0}


def test_planes_of_photographs_are_joined_by_a_similarity():
    """A tilt from the few ties of one overlap would bend the rest; the adjustment has more ties."""
    graph, tie = met_planes(0.2)
    ((change, moved, kept),) = joins([tie], graph, 1, SHAPE, is_survey=True)
    assert (moved, kept) == (0, 1)
    assert change[2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert graph.hosts(5) == {0}


def test_a_video_needs_a_tie_as_precise_as_an_ok_frame():
    """Points along one edge of the frame leave its other side open."""
    graph, tie = met_planes(0.0)
    assert not list(joins([replace(tie, corner_std=1.5)], graph, 1, SHAPE, is_survey=False))
    assert list(joins([replace(tie, corner_std=1.5)], graph, 1, SHAPE, is_survey=True))


@pytest.mark.parametrize("is_survey", [False, True])
def test_planes_that_stretch_each_other_stay_apart(is_survey):
    """No mosaic can show both."""
    graph, tie = met_planes(1.2)
    assert not list(joins([tie], graph, 1, SHAPE, is_survey))
    assert graph.hosts(5) == set()


def test_planes_of_a_video_that_no_motion_brings_together_stay_apart():
    """Relief or false matches: half of the points are 6 px off."""
    graph, tie = met_planes(0.0)
    points = tie.points + np.where(np.arange(60)[:, np.newaxis] % 2, [6.0, 0.0], 0.0)
    assert not list(joins([replace(tie, points=points)], graph, 1, SHAPE, is_survey=False))
    assert list(joins([replace(tie, points=points)], graph, 1, SHAPE, is_survey=True))
