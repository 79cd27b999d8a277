"""Ties between planes, and the joins that follow."""

from dataclasses import replace

import numpy as np
import pytest

from streamkit.geometry.homography import corners, project, translation
from streamkit_stitcher.plane.keyframe_graph import KeyframeGraph, Tie
from streamkit_stitcher.plane.keyframes import Keyframe
from streamkit_stitcher.plane.plane_joining import PlaneTies

SHAPE = (360, 640)


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
    ((change, moved, kept),) = PlaneTies().joins([tie], graph, 1, SHAPE, is_survey=False)
    assert (moved, kept) == (0, 1)
    places = project(change @ graph.homographies[0], tie.host_points)
    assert np.abs(places - project(graph.homographies[5], tie.points)).max() < 2.0
    assert graph.hosts(5) == {0}


def test_planes_of_photographs_are_joined_by_a_similarity():
    """A tilt from the few ties of one overlap would bend the rest; the adjustment has more ties."""
    graph, tie = met_planes(0.2)
    ((change, moved, kept),) = PlaneTies().joins([tie], graph, 1, SHAPE, is_survey=True)
    assert (moved, kept) == (0, 1)
    assert change[2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert graph.hosts(5) == {0}


def strip_ties():
    """Two planes of four frames each, flown side by side, and a tie of each pair over a narrow strip."""
    graph, random, ties = KeyframeGraph(max_tied=100), np.random.default_rng(2), []
    for index in range(8):
        graph.add(index, translation(np.array([200.0 * (index % 4), 0.0])), [], plane=index // 4)
    for index in range(4):
        points = random.uniform([0, 0], [640, 90], (60, 2))
        # The other strip lies 270 px lower.
        host_points = random.normal(points + np.array([0.0, 270.0]), 0.2)
        ties.append(Tie(index, index + 4, np.arange(60), host_points, points))
    return graph, ties


def test_a_video_joins_planes_by_several_ties_where_one_leaves_the_frame_open():
    """One narrow strip says little of the other side of the frame; four in a row do. Photographs need one."""
    graph, ties = strip_ties()
    assert len(list(PlaneTies().joins(ties[:1], graph, 1, SHAPE, is_survey=True))) == 1
    graph, ties = strip_ties()
    waiting = PlaneTies()
    for tie in ties[:2]:
        assert not list(waiting.joins([tie], graph, 1, SHAPE, is_survey=False))
        assert not graph.hosts(tie.observer)
    ((change, moved, kept),) = waiting.joins(ties[2:], graph, 1, SHAPE, is_survey=False)
    assert (moved, kept) == (0, 1)
    assert project(change, corners(SHAPE)) == pytest.approx(corners(SHAPE) - [0.0, 270.0], abs=0.5)
    assert [graph.hosts(index) for index in (4, 5, 6, 7)] == [{0}, {1}, {2}, {3}]


def test_a_tie_with_which_few_patches_agree_counts_less():
    """Half of the patches may be off the plane: what the others say is then less certain."""
    graph, ties = strip_ties()
    doubtful = [replace(tie, share=0.5) for tie in ties]
    assert not list(PlaneTies().joins(doubtful, graph, 1, SHAPE, is_survey=False))
    assert list(PlaneTies().joins(ties, graph, 1, SHAPE, is_survey=False))


def test_waiting_ties_show_where_keyframes_of_another_plane_lie():
    """Near the ties to a pixel, so that patches of more keyframes can be matched; others are not shown."""
    graph, ties = strip_ties()
    waiting = PlaneTies()
    assert not list(waiting.joins(ties[:1], graph, 1, SHAPE, is_survey=False))
    keyframes = [
        Keyframe(index, graph.homographies[index], SHAPE, 1, content=None, plane=graph.planes[index])
        for index in range(8)
    ]
    seen = waiting.seen_from(1, keyframes, graph)
    assert [(one.index, one.plane) for one in seen] == [(0, 1), (1, 1), (2, 1), (3, 1)]
    strip = np.array([[0.0, 315.0], [640.0, 315.0]])
    assert project(seen[0].to_reference, strip) == pytest.approx(strip - [0.0, 270.0], abs=1.0)
    assert not waiting.seen_from(2, keyframes, graph)


@pytest.mark.parametrize("is_survey", [False, True])
def test_planes_that_stretch_each_other_stay_apart(is_survey):
    """No mosaic can show both."""
    graph, tie = met_planes(1.2)
    assert not list(PlaneTies().joins([tie], graph, 1, SHAPE, is_survey))
    assert graph.hosts(5) == set()


def test_planes_of_a_video_that_no_motion_brings_together_stay_apart():
    """Relief or false matches: half of the points are 6 px off."""
    graph, tie = met_planes(0.0)
    points = tie.points + np.where(np.arange(60)[:, np.newaxis] % 2, [6.0, 0.0], 0.0)
    assert not list(PlaneTies().joins([replace(tie, points=points)], graph, 1, SHAPE, is_survey=False))
    assert list(PlaneTies().joins([replace(tie, points=points)], graph, 1, SHAPE, is_survey=True))
