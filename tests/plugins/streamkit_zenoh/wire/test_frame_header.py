"""The metadata of a frame is restored from the header, in pixels of the image."""

import json
import math

import numpy as np
import pytest

from streamkit import (
    Capture,
    Detections,
    Frame,
    Pose,
    Registration,
    RegistrationStatus,
    Track,
    Tracks,
    TrackState,
    raw_video_caps,
)
from streamkit_zenoh.wire.frame_header import frame_header, image_frame, read_header


def _frame() -> Frame:
    detections = Detections(
        np.array([[10.0, 20.0], [3.5, 4.5]]), np.array([[8.0, 18, 12, 22], [1, 2, 5, 6]]),
        np.array([12.0, 16.0]), np.array([0.5, 0.75]), ("car", ""), True,
    )  # fmt: skip
    registration = Registration(
        np.array([[1.0, 0, 2], [0, 1, -3], [0, 0, 1]]), np.diag([2.0, 2, 1]), 4, np.diag([3.0, 3, 1]),
        RegistrationStatus.WEAK, True, 90, 60, 0.5,
    )  # fmt: skip
    track = Track(9, TrackState.CONFIRMED, 30.0, 40.0, 8.0, 4.0, 0.5, (3.0, -1.0), np.eye(2), 0.9, 10**9)
    frame = Frame(
        np.zeros((48, 64), np.uint8), raw_video_caps("GRAY8", 64, 48), pts=123, duration=40, epoch=2, seq=17,
        capture=Capture(1_000, "misb"),
    )  # fmt: skip
    return frame.attach(detections, registration, Tracks((track,)), Pose(48.0, 11.0, 900.0, source="misb"))


def test_metadata_is_exact_at_full_size() -> None:
    """Times, registration, detections, tracks and pose."""
    given = _frame()
    header = read_header(frame_header(given, "uav/1", 5_000, 0, (48, 64)))
    frame = image_frame(np.zeros((48, 64), np.uint8), header, 77, 10)
    assert (frame.pts, frame.duration, frame.seq, frame.epoch) == (123, 40, 17, 12)
    assert frame.capture == given.capture
    assert frame.caps["format"] == "GRAY8"
    for kind in (Detections, Registration):
        ours, theirs = frame.get(kind), given.get(kind)
        for name in kind.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    assert frame.get(Pose) == given.get(Pose)
    tracks = frame.get(Tracks)
    assert tracks is not None
    assert (tracks.tracks[0].id, tracks.tracks[0].x, tracks.tracks[0].velocity) == (9, 30.0, (3.0, -1.0))


def test_metadata_is_scaled_with_the_image() -> None:
    """Scaled by a half, corners stay corners; the reference plane does not change."""
    header = read_header(frame_header(_frame(), "uav/1", 5_000, 0, (24, 32)))
    frame = image_frame(np.zeros((24, 32), np.uint8), header, 77, 0)
    detections, registration, tracks = frame.get(Detections), frame.get(Registration), frame.get(Tracks)
    assert detections is not None
    assert registration is not None
    assert tracks is not None
    np.testing.assert_allclose(detections.centroids[0], [10 / 2 - 0.25, 20 / 2 - 0.25])
    np.testing.assert_allclose(detections.areas, [3.0, 4.0])
    track = tracks.tracks[0]
    assert (track.x, track.y, track.length, track.width) == pytest.approx((14.75, 19.75, 4.0, 2.0))
    place = registration.to_reference @ np.array([14.75, 19.75, 1])
    np.testing.assert_allclose(place[:2] / place[2], [60.0, 80.0])
    before = registration.to_previous @ np.array([14.75, 19.75, 1])
    np.testing.assert_allclose(before[:2] / before[2], [32 / 2 - 0.25, 37 / 2 - 0.25])


def test_missing_metadata_stays_missing() -> None:
    """Unknown matrices stay unknown."""
    bare = Frame(np.zeros((4, 6, 3), np.uint8), raw_video_caps("BGR", 6, 4))
    header = read_header(frame_header(bare, "a", 1, 0, (4, 6, 3)))
    assert not image_frame(np.zeros((4, 6, 3), np.uint8), header, 1, 0).metadata
    lost = bare.attach(Registration(np.full((3, 3), math.nan), np.eye(3), rmse=math.nan))
    header = read_header(frame_header(lost, "a", 1, 0, (4, 6, 3)))
    registration = image_frame(np.zeros((4, 6, 3), np.uint8), header, 1, 0).get(Registration)
    assert registration is not None
    assert np.isnan(registration.to_previous).all()
    assert math.isnan(registration.rmse)


@pytest.mark.parametrize(
    "change", [{"picture_width": 0}, {"picture_width": 10**6}, {"schema": "x"}, {"record": 1}]
)
def test_invalid_headers_are_refused(change: dict[str, object]) -> None:
    """Sizes are bounded, the record is validated."""
    good = json.loads(frame_header(_frame(), "uav/1", 5_000, 0, (48, 64)))
    for data in (json.dumps({**good, **change}).encode(), b"", b"[" * 100_000):
        with pytest.raises(ValueError):  # noqa: PT011  each has its own words
            read_header(data)
