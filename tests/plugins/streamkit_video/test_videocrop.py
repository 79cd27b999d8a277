"""Tests of videocrop in pipelines."""

import numpy as np
import pytest

from streamkit import (
    Frame,
    Pipeline,
    Pose,
    Registration,
    StreamkitError,
    Track,
    Tracks,
    TrackState,
    raw_video_caps,
)
from streamkit.testing import Harness
from streamkit_video import TrueRegistration, TrueTargets
from tests.frames import frames_of
from tests.plugins.streamkit_video.peer import by_gstreamer, needs_gstreamer

SOURCE = "videotestsrc num-buffers=2 pattern=smpte ! video/x-raw, format={}, width=64, height=48"


@pytest.mark.parametrize("name", ["GRAY8", "BGR", "RGBA"])
def test_the_rest_is_what_numpy_slices(name: str) -> None:
    """Pixel for pixel; the frame is an array of its own."""
    whole = frames_of(SOURCE.format(name))
    cut = frames_of(f"{SOURCE.format(name)} ! videocrop top=3 bottom=4 left=5 right=10")
    assert len(cut) == 2
    for before, after in zip(whole, cut, strict=True):
        np.testing.assert_array_equal(after.data, before.data[3:44, 5:54])
        assert (after.caps["width"], after.caps["height"], after.pts) == (49, 41, before.pts)
        assert after.data.flags.c_contiguous


@needs_gstreamer
@pytest.mark.parametrize("name", ["GRAY8", "BGR", "I420", "NV12"])
def test_the_rest_is_what_gstreamer_leaves(name: str) -> None:
    """Also where the first column is odd: the chroma then begins one pixel earlier."""
    line = "videocrop top=3 bottom=5 left=7 right=9"
    whole = frames_of(SOURCE.format(name))[0]
    cut = frames_of(f"{SOURCE.format(name)} ! {line}")[0]
    np.testing.assert_array_equal(cut.data, by_gstreamer(whole, line, cut.data.shape))


def test_caps_are_negotiated_through_it() -> None:
    """What is asked for behind it decides the size before it."""
    (frame,) = frames_of(
        "videotestsrc num-buffers=1 ! videocrop left=4 top=2 ! video/x-raw, width=60, height=50"
    )
    assert (frame.caps["width"], frame.caps["height"]) == (60, 50)
    (frame,) = frames_of(
        "videotestsrc num-buffers=1 ! videocrop left=4 ! video/x-raw, width={ 60, 64 }, height=50"
    )
    assert frame.caps["width"] in (60, 64)


def test_frames_pass_untouched_without_borders() -> None:
    """The very array comes out."""
    frame = Frame(np.zeros((12, 16), np.uint8), raw_video_caps("GRAY8", 16, 12))
    with Harness("videocrop") as harness:
        (out,) = harness.push(frame)
    assert out.data is frame.data


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("videocrop left=40 right=24", r"videocrop0: nothing is left of 64x48 px without 40 \+ 24 columns"),
        ("videocrop top=1", "videocrop0: I420 needs an even width and height, got 64x47: use"),
    ],
)
def test_what_leaves_no_frame_is_a_clear_error(line: str, message: str) -> None:
    """The error names the element, the sizes and the remedy."""
    with pytest.raises(StreamkitError, match=message):
        frames_of(f"{SOURCE.format('I420')} ! {line}")


def test_truth_stays_true() -> None:
    """Homographies and targets of a synthetic flight move with its pixels."""
    text = "dronetestsrc num-buffers=4 seed=1"
    for whole, cut in zip(frames_of(text), frames_of(f"{text} ! videocrop left=100 top=60"), strict=True):
        before, after = whole.get(TrueTargets), cut.get(TrueTargets)
        assert before is not None
        assert after is not None
        np.testing.assert_allclose(after.centres, before.centres - (100, 60))
        was, is_now = whole.get(TrueRegistration), cut.get(TrueRegistration)
        assert was is not None
        assert is_now is not None
        old = was.to_previous @ (300.0, 200.0, 1.0)
        new = is_now.to_previous @ (200.0, 140.0, 1.0)
        np.testing.assert_allclose(new[:2] / new[2], old[:2] / old[2] - (100, 60))


def test_tracks_and_registration_move_with_the_pixels() -> None:
    """The reference plane stays; the view that a pose describes is left out, its position stays."""
    track = Track(3, TrackState.CONFIRMED, 12.0, 8.0, 4.0, 2.0, 0.3, (1.0, 2.0), np.diag([1.0, 2.0]), 0.9, 7)
    pose = Pose(50.0, 8.0, 100.0, field_of_view=(1.0, 0.6), corners=((50.0, 8.0),))
    frame = Frame(np.zeros((24, 32), np.uint8), raw_video_caps("GRAY8", 32, 24), pts=0)
    frame = frame.attach(Registration(np.eye(3), np.eye(3)), Tracks((track,)), pose)
    with Harness("videocrop", left=10, top=4) as harness:
        (out,) = harness.push(frame)
    (moved,) = out.tracks
    assert (moved.x, moved.y, moved.length, moved.angle) == pytest.approx((2.0, 4.0, 4.0, 0.3))
    assert moved.velocity == (1.0, 2.0)
    np.testing.assert_array_equal(moved.covariance, track.covariance)
    assert out.registration is not None
    np.testing.assert_array_equal(out.registration.to_reference, [[1, 0, 10], [0, 1, 4], [0, 0, 1]])
    kept = out.get(Pose)
    assert kept is not None
    assert (kept.latitude, kept.field_of_view, kept.corners) == (50.0, None, ())


def test_a_tracked_flight_may_be_cropped_anywhere() -> None:
    """Before the tracker, and between its elements, where detections lie outside."""
    text = "dronetestsrc num-buffers=30 seed=1 ! {} stitch ! framediff ! {} particletrack ! fakesink"
    for first, second in (("videocrop top=40 !", ""), ("", "videocrop left=600 top=300 !")):
        with Pipeline.parse(text.format(first, second)) as pipeline:
            pipeline.run(timeout_s=60)
