"""Which targets are reported."""

import numpy as np
import pytest

from streamkit_tracker.observation import Observation
from streamkit_tracker.tracker import MultiTargetTracker

IMAGE = np.zeros((200, 400), np.uint8)


def seen(index: int, *, are_objects: bool) -> Observation:
    """One detection of 30x80 px that moves to the right."""
    box = np.array([[40.0, 60, 70, 140]]) + 2 * index * np.array([1, 0, 1, 0])
    return Observation(0.04, centroids=(box[:, :2] + box[:, 2:]) / 2, boxes=box, are_objects=are_objects)


@pytest.mark.parametrize(("frames_detected", "is_long"), [(4, False), (10, True), (60, True)])
def test_an_object_detected_for_long_is_reported_through_a_gap(frames_detected: int, is_long: bool):
    """As long as its position is known: not before its velocity is, nor for as long as it is kept."""
    tracker = MultiTargetTracker()
    for index in range(frames_detected):
        tracker.step(IMAGE, seen(index, are_objects=True))
    gap = [tracker.step(IMAGE, Observation(0.04, are_objects=True)) for _ in range(13)]
    reported = [len(frame) for frame in gap]
    assert reported[:2] == [1, 1]
    assert reported[4] == is_long
    assert reported[-1] == 0
    assert len(tracker.targets.rows) == 1


@pytest.mark.parametrize(("frames_detected", "is_long"), [(6, False), (40, True)])
def test_a_region_is_reported_through_a_gap_once_it_was_detected_for_long(
    frames_detected: int, is_long: bool
):
    """What moved for less than half a second may be false: it is reported while it is detected."""
    tracker = MultiTargetTracker()
    detected = [tracker.step(IMAGE, seen(index, are_objects=False)) for index in range(frames_detected)]
    gap = [tracker.step(IMAGE, Observation(0.04)) for _ in range(40)]
    assert [report.state for report in detected[-1]] == ["confirmed"]
    assert [report.state for report in gap[0]] == ["coasting"] * is_long
    assert gap[-1] == ()
