"""Keyframes and their ties as an adjustment problem."""

import numpy as np
import pytest

from streamkit.geometry.homography import project, translation
from streamkit_stitcher.bundle_adjustment.adjustment import adjust
from streamkit_stitcher.plane.keyframe_graph import KeyframeGraph, Tie


def shift(x):
    """The homography of a shift along x."""
    return translation(np.array([float(x), 0.0]))


def tie(host, observer, step=100.0, first=0, count=30):
    """Patches of `host` seen `step` px to the left in `observer`."""
    random = np.random.default_rng(host)
    points = random.uniform(100, 600, (count, 2))
    return Tie(host, observer, np.arange(first, first + count), points, points - [step, 0.0])


@pytest.fixture
def graph():
    """Four keyframes 100 px apart, each with an error of 3 px."""
    graph = KeyframeGraph(max_tied=100)
    graph.add(0, np.eye(3), [])
    graph.add(1, shift(103), [tie(0, 1)])
    graph.add(2, shift(206), [tie(1, 2), tie(0, 2, 200.0)])
    graph.add(3, shift(309), [tie(2, 3), tie(1, 3, 200.0)])
    return graph


def test_an_adjustment_puts_the_frames_right(graph):
    """A patch seen in several frames is one point; the reference holds still."""
    problem, indices = graph.problem(tuple(graph.homographies), [0])
    assert indices == (0, 1, 2, 3)
    assert len(problem.points) == 90
    assert len(problem.observed) == 5 * 30 + 3 * 30
    result = adjust(problem)
    places = {index: np.linalg.inv(result.cameras[number]) for number, index in enumerate(indices)}
    graph.move(places)
    for index, place in graph.homographies.items():
        assert project(place / place[2, 2], np.zeros((1, 2)))[0] == pytest.approx(
            [100.0 * index, 0.0], abs=1e-3
        )


def test_outside_the_window_nothing_moves(graph):
    """Frames that the window is tied to hold it; others do not even take part."""
    problem, indices = graph.problem([3], [0])
    assert indices == (1, 2, 3)
    assert problem.fixed.tolist() == [True, True, False]


def test_a_plane_can_be_the_one_of_another_frame(graph):
    """After a rebase that keyframe has the identity, and distances stay."""
    graph.rebase(np.linalg.inv(graph.homographies[2]), 0, 0)
    assert graph.homographies[2] == pytest.approx(np.eye(3))
    assert graph.homographies[3] == pytest.approx(shift(103))


def test_ties_are_bounded():
    """Old ties are dropped, the homographies stay."""
    graph = KeyframeGraph(max_tied=3)
    for index in range(6):
        graph.add(index, shift(index), [tie(index - 1, index)] if index else [])
    assert graph.tied == (3, 4, 5)
    assert tuple(graph.homographies) == (0, 1, 2, 3, 4, 5)
    graph.tie(tie(0, 1))
    assert graph.hosts(1) == set()


def test_ties_are_thinned_evenly():
    """A tie keeps first and last of its patches."""
    thin = tie(0, 1, count=100).thinned(10)
    assert len(thin.points) == 10
    assert (thin.patches[0], thin.patches[-1]) == (0, 99)


def test_without_ties_there_is_nothing_to_adjust():
    """A single frame makes no problem, nor does one where all hold still."""
    graph = KeyframeGraph(10)
    graph.add(0, np.eye(3), [])
    assert graph.problem([0], [0]) is None


def test_the_oldest_homographies_are_dropped_unless_needed():
    """Places are bounded; what was named or has ties stays; the count goes on."""
    graph = KeyframeGraph(max_tied=3)
    for index in range(50):
        ties = [tie(2, index)] if index == 10 else []
        graph.add(index, np.eye(3), ties)
        graph.forget(20, {2})
    assert len(graph.homographies) <= 21
    assert {2, 47, 48, 49} <= graph.homographies.keys()
    assert 10 not in graph.homographies
    assert graph.added[0] == 50
    graph.rebase(shift(1), 0, 0)


def test_keyframes_are_counted_along_their_ties(graph):
    """The shortest way counts, in either direction; what has no tie is not reached."""
    graph.add(4, shift(400), [])
    assert graph.steps_from(3) == {3: 0, 2: 1, 1: 1, 0: 2}
    assert graph.steps_from(0) == {0: 0, 1: 1, 2: 1, 3: 2}
    assert graph.steps_from(4) == {4: 0}
