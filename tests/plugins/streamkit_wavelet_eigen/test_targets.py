"""The targets that waveleteigen cuts windows around."""

import numpy as np
import pytest

from streamkit import Detections, Frame, PropertyError, Track, Tracks, TrackState, raw_video_caps
from streamkit.testing import Harness
from streamkit_wavelet_eigen.target_features import TargetFeatures


def _frame() -> Frame:
    image = np.random.default_rng(0).integers(0, 256, (60, 80), np.uint8)
    return Frame(image, raw_video_caps("GRAY8", 80, 60))


def _targets(frame: Frame, **properties: str) -> TargetFeatures | None:
    """What waveleteigen attaches to a frame that comes twice, so that there is a space."""
    with Harness("waveleteigen", mode="raw", **properties) as harness:
        harness.push(frame)
        (out,) = harness.push(frame)
    return out.get(TargetFeatures)


def _track(number: int, angle: float) -> Track:
    return Track(
        number, TrackState.CONFIRMED, 30.0 + number, 20.0, 16.0, 8.0, angle, (0.0, 0.0), np.eye(2), 1.0, 0
    )


def test_detections_are_upright_boxes() -> None:
    """Centre from the centroid, size from the box, no turn; ids are row numbers."""
    boxes = np.array([[10.0, 20, 30, 26], [40, 10, 44, 30]])
    frame = _frame().attach(Detections(np.array([[21.0, 23], [42, 20]]), boxes, np.ones(2), np.ones(2)))
    targets = _targets(frame)
    assert targets is not None
    assert targets.boxes.tolist() == [[21, 23, 20, 6, 0], [42, 20, 4, 20, 0]]
    assert (targets.kind, targets.ids.tolist()) == ("detections", [0, 1])


def test_tracks_keep_ids_and_angles() -> None:
    """A track's own place, size and turn."""
    targets = _targets(_frame().attach(Tracks((_track(4, 0.5), _track(9, -1.0)))), targets="tracks")
    assert targets is not None
    assert targets.boxes.tolist() == [[34, 20, 16, 8, 0.5], [39, 20, 16, 8, -1.0]]
    assert (targets.kind, targets.ids.tolist()) == ("tracks", [4, 9])


def test_a_frame_without_targets_has_none() -> None:
    """Neither metadata that is missing nor metadata that is empty is a target."""
    none = np.zeros((0, 2))
    empty = _frame().attach(Tracks(), Detections(none, np.zeros((0, 4)), np.zeros(0), np.zeros(0)))
    for frame in (_frame(), empty):
        assert _targets(frame) is None
        assert _targets(frame, targets="tracks") is None


def test_a_given_window_covers_its_pixels() -> None:
    """A window of 20 pixels from 10 on has its middle at 19.5."""
    targets = _targets(_frame(), window="10,20,20,8,0.25")
    assert targets is not None
    assert targets.boxes.tolist() == [[19.5, 23.5, 20, 8, 0.25]]
    assert targets.kind == "window"


@pytest.mark.parametrize(
    "text", ["", "1,2,3", "a,b,c,d", "1,2,0,5", "1,2,3,-5", "nan,1,2,3", "1,2,3,4,5,6", "1,2,inf,4"]
)
def test_what_is_no_window_is_refused(text: str) -> None:
    """The error names the element, shows the text and gives an example."""
    with pytest.raises(PropertyError, match=r"waveleteigen0: property window .* for example 100,"):
        Harness("waveleteigen", name="waveleteigen0", window=text)
