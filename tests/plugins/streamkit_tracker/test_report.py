"""Which targets are reported."""

import numpy as np
import pytest

from streamkit_tracker.observation import Observation
from streamkit_tracker.tracker import MultiTargetTracker

IMAGE = np.zeros((200, 400), np.uint8)


@pytest.mark.parametrize(("frames_detected", "is_long"), [(10, False), (60, True)])
def test_an_object_detected_for_long_is_reported_through_a_gap(frames_detected: int, is_long: bool):
    """For more than the two frames in which any target coasts, but not for as long as its track is kept."""
    tracker = MultiTargetTracker()
    for index in range(frames_detected):
        box = np.array([[40.0, 60, 70, 140]]) + 2 * index * np.array([1, 0, 1, 0])
        centroid = (box[:, :2] + box[:, 2:]) / 2
        tracker.step(IMAGE, Observation(0.04, centroids=centroid, boxes=box, are_objects=True))
    gap = [tracker.step(IMAGE, Observation(0.04, are_objects=True)) for _ in range(13)]
    reported = [len(frame) for frame in gap]
    assert reported[:2] == [1, 1]
    assert reported[4] == is_long
    assert reported[-1] == 0
    assert len(tracker.targets.rows) == 1
