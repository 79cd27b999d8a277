"""Tracks start from the detections of an element that this project did not make."""

import cv2
import numpy as np
import pytest

from streamkit import LUMA_CAPS, Detections, Frame, Tracks, TrackState, Transform, luma, raw_video_caps
from streamkit.testing import Harness


class BrightSpots(Transform):
    """A detector as a stranger would write it: whatever is brighter than 200, without registration.

    It looks at every `period`-th frame, and lets the others pass without Detections.
    """

    sink = src = LUMA_CAPS
    period = 1
    are_objects = False

    def transform(self, frame: Frame) -> Frame:
        """Attaches Detections."""
        if frame.seq % self.period:
            return frame
        mask = (luma(frame) > 200).astype(np.uint8)
        count, _, stats, centres = cv2.connectedComponentsWithStats(mask)
        left, top, width, height, area = stats[1:].T.astype(np.float64)
        boxes = np.column_stack([left, top, left + width, top + height]).reshape(-1, 4)
        return frame.attach(
            Detections(centres[1:], boxes, area, np.ones(count - 1), are_objects=self.are_objects)
        )


def spots(centres: np.ndarray) -> np.ndarray:
    """uint8[120, 200], a frame with bright rectangles of 13x9 px at `centres` float64[n, 2]."""
    image = np.full((120, 200), 60, np.uint8)
    for x, y in centres:
        cv2.rectangle(image, (int(x) - 6, int(y) - 4), (int(x) + 6, int(y) + 4), 240, -1)
    return image


def test_a_strangers_detections_become_tracks():
    """Two spots that cross each other's column keep their ids, and are where they were drawn."""
    caps = raw_video_caps("GRAY8", 200, 120)
    starts, steps = np.array([[30.0, 30], [160, 90]]), np.array([[3.0, 0], [-3, 0]])
    numbers = []
    with Harness(BrightSpots()) as detector, Harness("particletrack") as tracker:
        for index in range(30):
            image = spots(starts + index * steps)
            (found,) = detector.push(Frame(image, caps, pts=index * 40_000_000, seq=index))
            (out,) = tracker.push(found)
            tracks = out.get(Tracks)
            assert tracks is not None
            seen = [track for track in tracks.tracks if track.state == TrackState.CONFIRMED]
            numbers.append([track.id for track in seen])
    assert numbers[10:] == [numbers[10]] * 20
    assert len(numbers[10]) == 2
    np.testing.assert_allclose([[track.x, track.y] for track in seen], starts + 29 * steps, atol=1.5)


@pytest.mark.parametrize("are_objects", [False, True])
def test_a_detector_may_leave_out_frames(are_objects: bool):
    """A frame without Detections misses no target: its track goes on."""
    caps = raw_video_caps("GRAY8", 200, 120)
    starts, steps = np.array([[30.0, 30], [160, 90]]), np.array([[1.0, 0], [-1, 0]])
    detector = BrightSpots()
    detector.period, detector.are_objects = 5, are_objects
    with Harness(detector) as first, Harness("particletrack") as tracker:
        for index in range(60):
            frame = Frame(spots(starts + index * steps), caps, pts=index * 40_000_000, seq=index)
            (out,) = tracker.push(*first.push(frame))
            tracks = out.get(Tracks)
            assert tracks is not None
            if index < 20:
                continue
            assert [track.id for track in tracks.tracks] == [1, 2]
            centres = [[track.x, track.y] for track in tracks.tracks]
            np.testing.assert_allclose(centres, starts + index * steps, atol=2.0)
            if index % 5 == 0:
                assert {track.state for track in tracks.tracks} == {TrackState.CONFIRMED}


def test_a_detector_that_stops_ends_its_targets():
    """Targets coast for `coast` seconds at most after the last frame that a detector has looked at."""
    caps = raw_video_caps("GRAY8", 200, 120)
    states = []
    with Harness(BrightSpots()) as detector, Harness("particletrack", coast=0.4) as tracker:
        for index in range(30):
            frame = Frame(spots(np.array([[30.0 + 3 * index, 30]])), caps, pts=index * 40_000_000, seq=index)
            if index < 15:
                (frame,) = detector.push(frame)
            else:
                frame = frame.replace(data=spots(np.zeros((0, 2))))
            (out,) = tracker.push(frame)
            tracks = out.get(Tracks)
            assert tracks is not None
            states.append([track.state for track in tracks.tracks])
    assert states[14] == [TrackState.CONFIRMED]
    assert states[25:] == [[TrackState.LOST], [], [], [], []]
