"""A frame becomes a record and a frame again; unknown values stay unknown."""

import json

import numpy as np
import pytest

from streamkit import (
    Caps,
    Capture,
    Frame,
    Registration,
    RegistrationStatus,
    StreamError,
    Track,
    Tracks,
    TrackState,
    decode_record,
    encode_record,
    raw_video_caps,
    record_line,
    track_record,
)
from streamkit_zenoh.zenohsrc import record_frame


def _track(number: int, velocity: tuple[float, float] = (3.0, -1.5)) -> Track:
    covariance = np.array([[1.5, 0.25], [0.25, 0.75]])
    return Track(number, TrackState.CONFIRMED, 10.5, 20.25, 8.0, 4.0, 0.5, velocity, covariance, 0.9, 10**9)


def _frame() -> Frame:
    return Frame(
        np.zeros((4, 6), np.uint8),
        raw_video_caps("GRAY8", 6, 4),
        pts=123,
        epoch=2,
        seq=17,
        capture=Capture(1_000, "misb"),
    ).attach(
        Tracks((_track(1), _track(5))),
        Registration(np.eye(3), np.diag([1.0, 2.0, 1.0]), reference=4, status=RegistrationStatus.WEAK),
    )


def _payload(frame: Frame, source: str, published_ns: int, dropped: int = 0) -> bytes:
    return encode_record(track_record(frame, source=source, published_ns=published_ns, dropped=dropped))


def _received(payload: bytes, arrival_ns: int, epoch: int = 0) -> Frame:
    return record_frame(decode_record(payload), payload, arrival_ns, epoch)


def test_a_record_restores_the_frames_times_and_metadata() -> None:
    """Times, tracks and registration are exact."""
    given = _frame()
    frame = _received(_payload(given, "uav/1", 5_000), 77, 10)
    assert (frame.pts, frame.seq, frame.epoch, frame.arrival_ns) == (123, 17, 12, 77)
    assert frame.capture == given.capture
    assert str(frame.caps) == "application/x-tracks, width=(int)6, height=(int)4" or frame.caps["width"] == 6
    tracks, registration = frame.get(Tracks), frame.get(Registration)
    assert tracks is not None
    assert registration is not None
    for ours, theirs in zip(tracks.tracks, (_track(1), _track(5)), strict=True):
        for field in ("id", "state", "x", "y", "length", "width", "angle", "velocity", "score", "age_ns"):
            assert getattr(ours, field) == getattr(theirs, field)
        np.testing.assert_array_equal(ours.covariance, theirs.covariance)
    np.testing.assert_array_equal(registration.to_reference, np.diag([1.0, 2.0, 1.0]))
    assert (registration.reference, registration.status) == (4, RegistrationStatus.WEAK)
    assert np.isnan(registration.to_previous).all()


def test_unknown_values_are_nan() -> None:
    """An unknown velocity is not zero; nor is a size."""
    frame = Frame(b"", Caps("video/x-raw")).attach(Tracks((_track(1, (float("nan"), 0.0)),)))
    received = _received(_payload(frame, "a", 1), 1)
    tracks = received.get(Tracks)
    assert tracks is not None
    assert np.isnan(tracks.tracks[0].velocity).all()
    assert received.get(Registration) is None
    assert (received.pts, received.capture, received.caps.get("width")) == (None, None, None)


def test_a_received_record_is_passed_on_unchanged() -> None:
    """Even the bytes are those of the first publisher."""
    payload = _payload(_frame(), "uav/1", 5_000, 3)
    assert record_line(_received(payload, 1)) == payload
    assert _payload(_received(payload, 1), "other", 9_000) == payload


def test_a_record_on_many_lines_becomes_one() -> None:
    """A record of another publisher may be indented; in a file it is one line, with all its fields."""
    record = track_record(_frame(), source="uav/1", published_ns=5_000)
    fields = {**json.loads(encode_record(record)), "note": "line 1\nline 2"}
    passed = record_line(Frame(json.dumps(fields, indent=2).encode(), Caps("application/x-tracks")))
    assert b"\n" not in passed
    assert decode_record(passed) == record
    assert json.loads(passed) == fields


@pytest.mark.parametrize("data", [b"", b"{}", b'{"schema": "streamkit.tracks/2"}', b"\x00\xff" * 50])
def test_invalid_records_are_refused(data: bytes) -> None:
    """Both functions raise StreamError."""
    with pytest.raises(StreamError, match="not a track record"):
        record_line(Frame(data, Caps("application/x-tracks")))
    with pytest.raises(StreamError, match="not a track record"):
        _payload(Frame(data, Caps("application/x-tracks")), "a", 1)
