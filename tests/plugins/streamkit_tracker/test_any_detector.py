"""Tracks start from the detections of an element that this project did not make."""

import cv2
import numpy as np

from streamkit import LUMA_CAPS, Detections, Frame, Tracks, TrackState, Transform, luma, raw_video_caps
from streamkit.testing import Harness


class BrightSpots(Transform):
    """A detector as a stranger would write it: whatever is brighter than 200, without registration."""

    sink = src = LUMA_CAPS

    def transform(self, frame: Frame) -> Frame:
        """Attaches Detections."""
        mask = (luma(frame) > 200).astype(np.uint8)
        count, _, stats, centres = cv2.connectedComponentsWithStats(mask)
        left, top, width, height, area = stats[1:].T.astype(np.float64)
        boxes = np.column_stack([left, top, left + width, top + height]).reshape(-1, 4)
        return frame.attach(Detections(centres[1:], boxes, area, np.ones(count - 1)))


def test_a_strangers_detections_become_tracks():
    """Two spots that cross each other's column keep their ids, and are where they were drawn."""
    caps = raw_video_caps("GRAY8", 200, 120)
    starts, steps = np.array([[30.0, 30], [160, 90]]), np.array([[3.0, 0], [-3, 0]])
    numbers = []
    with Harness(BrightSpots()) as detector, Harness("particletrack") as tracker:
        for index in range(30):
            image = np.full((120, 200), 60, np.uint8)
            for x, y in starts + index * steps:
                cv2.rectangle(image, (int(x) - 6, int(y) - 4), (int(x) + 6, int(y) + 4), 240, -1)
            (found,) = detector.push(Frame(image, caps, pts=index * 40_000_000, seq=index))
            (out,) = tracker.push(found)
            tracks = out.get(Tracks)
            assert tracks is not None
            seen = [track for track in tracks.tracks if track.state == TrackState.CONFIRMED]
            numbers.append([track.id for track in seen])
    assert numbers[10:] == [numbers[10]] * 20
    assert len(numbers[10]) == 2
    np.testing.assert_allclose([[track.x, track.y] for track in seen], starts + 29 * steps, atol=1.5)
