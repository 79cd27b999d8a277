"""Which windows an element looks at."""

import numpy as np
import pytest

from streamkit import Detections, Frame, PropertyError, Track, Tracks, TrackState, raw_video_caps
from streamkit_wavelet_eigen.targets import fixed_window, read_detections, read_tracks


def _frame() -> Frame:
    return Frame(np.zeros((60, 80), np.uint8), raw_video_caps("GRAY8", 80, 60))


def _track(number: int, angle: float) -> Track:
    return Track(
        number, TrackState.CONFIRMED, 30.0 + number, 20.0, 16.0, 8.0, angle, (0.0, 0.0), np.eye(2), 1.0, 0
    )


def test_detections_are_upright_boxes() -> None:
    """Centre from the centroid, size from the box, no turn; ids are row numbers."""
    boxes = np.array([[10.0, 20, 30, 26], [40, 10, 44, 30]])
    frame = _frame().attach(Detections(np.array([[21.0, 23], [42, 20]]), boxes, np.ones(2), np.ones(2)))
    targets = read_detections(frame)
    assert targets is not None
    assert targets.boxes.tolist() == [[21, 23, 20, 6, 0], [42, 20, 4, 20, 0]]
    assert (targets.kind, targets.ids.tolist()) == ("detections", [0, 1])


def test_tracks_keep_ids_and_angles() -> None:
    """A track's own place, size and turn."""
    targets = read_tracks(_frame().attach(Tracks((_track(4, 0.5), _track(9, -1.0)))))
    assert targets is not None
    assert targets.boxes.tolist() == [[34, 20, 16, 8, 0.5], [39, 20, 16, 8, -1.0]]
    assert (targets.kind, targets.ids.tolist()) == ("tracks", [4, 9])


def test_a_frame_without_targets_has_none() -> None:
    """Neither metadata that is missing nor metadata that is empty is a target."""
    none = np.zeros((0, 2))
    empty = _frame().attach(Tracks(), Detections(none, np.zeros((0, 4)), np.zeros(0), np.zeros(0)))
    for frame in (_frame(), empty):
        assert read_detections(frame) is None
        assert read_tracks(frame) is None


def test_a_given_window_covers_its_pixels() -> None:
    """A window of 20 pixels from 10 on has its middle at 19.5."""
    targets = fixed_window("10,20,20,8,0.25", "waveleteigen0")(_frame())
    assert targets is not None
    assert targets.boxes.tolist() == [[19.5, 23.5, 20, 8, 0.25]]
    assert targets.kind == "window"


@pytest.mark.parametrize(
    "text", ["", "1,2,3", "a,b,c,d", "1,2,0,5", "1,2,3,-5", "nan,1,2,3", "1,2,3,4,5,6", "1,2,inf,4"]
)
def test_what_is_no_window_is_refused(text: str) -> None:
    """The error names the element, shows the text and gives an example."""
    with pytest.raises(PropertyError, match=r"waveleteigen0: property window .* write for example window="):
        fixed_window(text, "waveleteigen0")
