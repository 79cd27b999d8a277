"""Track records: JSON format, and invalid records."""

import json
import math
from typing import Any

import msgspec
import numpy as np
import pytest

from streamkit import (
    Caps,
    Capture,
    Frame,
    Pose,
    Registration,
    RegistrationStatus,
    StreamError,
    Track,
    TrackRecord,
    Tracks,
    TrackState,
    decode_record,
    encode_record,
    raw_video_caps,
    track_record,
)


def _track(**changes: Any) -> Track:
    values: dict[str, Any] = {
        "id": 7,
        "state": TrackState.CONFIRMED,
        "x": 812.4,
        "y": 377.0,
        "length": 30.0,
        "width": 14.0,
        "angle": 0.0,
        "velocity": (61.0, -4.2),
        "covariance": np.array([[1.1, 0.0], [0.0, 0.9]]),
        "score": 0.87,
        "age_ns": 3_120_000_000,
    }
    return Track(**{**values, **changes})


def _frame(*items: object, capture: Capture | None = None) -> Frame:
    caps = raw_video_caps("GRAY8", 1920, 1080)
    frame = Frame(b"", caps, pts=4_800_000_000, epoch=2, seq=120, capture=capture)
    return frame.attach(*items)


def _registration(to_reference: np.ndarray, corner_std: float | None = None) -> Registration:
    return Registration(to_previous=np.eye(3), to_reference=to_reference, reference=3, corner_std=corner_std)


@pytest.mark.parametrize(
    ("origin", "is_aged"), [("rtcp", True), ("arrival", True), ("misb", False), ("file", False)]
)
def test_a_recording_has_no_age(origin: Any, is_aged: bool) -> None:
    """Its telemetry tells when it was recorded, which may be years ago; a live clock is taken at its word."""
    year_ns = 365 * 86_400 * 10**9
    old = track_record(_frame(capture=Capture(1, origin)), source="f", published_ns=year_ns)
    new = track_record(_frame(capture=Capture(1, origin)), source="f", published_ns=1_000_001)
    assert ((old.age_ms is not None), new.age_ms) == (is_aged, 1.0)


def test_json_format() -> None:
    """Names, order and meaning of the fields are public."""
    capture = Capture(1_763_690_000_123_456_789, "rtcp")
    frame = _frame(Tracks((_track(),)), _registration(np.eye(3)), capture=capture)
    record = track_record(frame, source="uav/1", published_ns=1_763_690_000_171_000_000, dropped=4)
    assert list(json.loads(encode_record(record)).items()) == [
        ("schema", "streamkit.tracks/1"),
        ("source", "uav/1"),
        ("seq", 120),
        ("epoch", 2),
        ("pts_ns", 4_800_000_000),
        ("capture_ns", 1_763_690_000_123_456_789),
        ("capture_origin", "rtcp"),
        ("published_ns", 1_763_690_000_171_000_000),
        ("age_ms", 47.543),
        ("width", 1920),
        ("height", 1080),
        (
            "registration",
            {"reference": 3, "to_reference": [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]], "status": "ok"},
        ),
        (
            "tracks",
            [
                {
                    "id": 7,
                    "state": "confirmed",
                    "x": 812.4,
                    "y": 377.0,
                    "length": 30.0,
                    "width": 14.0,
                    "angle": 0.0,
                    "bbox": [797.4, 370.0, 827.4, 384.0],
                    "vx": 61.0,
                    "vy": -4.2,
                    "position_covariance": [[1.1, 0.0], [0.0, 0.9]],
                    "score": 0.87,
                    "age_ns": 3_120_000_000,
                }
            ],
        ),
        ("dropped", 4),
    ]


def test_missing_values_are_left_out() -> None:
    """Neither null nor zero."""
    frame = Frame(b"", Caps("video/x-raw"))
    written = json.loads(encode_record(track_record(frame, source="a", published_ns=5)))
    assert written == {
        "schema": "streamkit.tracks/1",
        "source": "a",
        "seq": 0,
        "epoch": 0,
        "published_ns": 5,
        "tracks": [],
        "dropped": 0,
    }


def test_numbers_that_are_not_finite_are_left_out() -> None:
    """JSON has no NaN."""
    track = _track(velocity=(math.nan, 1.0), covariance=np.full((2, 2), np.inf))
    frame = _frame(Tracks((track,)), _registration(np.full((3, 3), np.nan), math.nan))
    record = track_record(frame, source="a", published_ns=5)
    written = encode_record(record)
    assert b"null" not in written
    assert record.registration is not None
    assert (record.registration.to_reference, record.registration.corner_std) == (None, None)
    assert not {"vx", "vy", "position_covariance"} & set(json.loads(written)["tracks"][0])


@pytest.mark.parametrize("field", ["x", "y", "length", "width", "angle", "score"])
def test_a_track_without_a_finite_position_is_an_error(field: str) -> None:
    """The error names the track."""
    frame = _frame(Tracks((_track(id=31, **{field: math.nan}),)))
    with pytest.raises(ValueError, match=r"track 31: .* must be finite"):
        track_record(frame, source="a", published_ns=5)


@pytest.mark.parametrize("angle", [0.0, 0.41, math.pi / 2, -2.2, 3.0])
def test_bbox_holds_the_rotated_rectangle(angle: float) -> None:
    """The upright box is that of the four corners."""
    track = _track(angle=angle)
    record = track_record(_frame(Tracks((track,))), source="a", published_ns=5)
    along = np.array([math.cos(angle), math.sin(angle)]) * track.length / 2
    across = np.array([-math.sin(angle), math.cos(angle)]) * track.width / 2
    corners = np.array([[track.x, track.y] + i * along + j * across for i in (-1, 1) for j in (-1, 1)])
    expected = [*corners.min(axis=0), *corners.max(axis=0)]
    np.testing.assert_allclose(record.tracks[0].bbox, expected, atol=1e-9)


def test_decode_is_the_inverse_of_encode() -> None:
    """Exactly."""
    generator = np.random.default_rng(3)
    tracks = tuple(
        _track(
            id=index,
            state=list(TrackState)[index % 4],
            x=float(generator.normal(500, 300)),
            velocity=tuple(generator.normal(0, 50, 2)),
            covariance=generator.normal(size=(2, 2)),
        )
        for index in range(20)
    )
    frame = _frame(Tracks(tracks), _registration(generator.normal(size=(3, 3))), capture=Capture(-5, "file"))
    record = track_record(frame, source="uav/1", published_ns=17, dropped=3)
    assert decode_record(encode_record(record)) == record
    assert record.tracks[4].x == tracks[4].x


def test_numpy_numbers_are_accepted() -> None:
    """They become Python numbers."""
    track = _track(id=np.int64(5), x=np.float32(3.5), age_ns=np.int64(9), score=np.float64(0.5))
    record = track_record(_frame(Tracks((track,))), source="a", published_ns=5)
    assert decode_record(encode_record(record)) == record


def test_unknown_fields_are_skipped() -> None:
    """Of a later version."""
    record = track_record(_frame(Tracks((_track(),))), source="a", published_ns=5)
    fields = json.loads(encode_record(record))
    fields["weather"] = {"wind": [1, 2]}
    fields["tracks"][0]["colour"] = "red"
    assert decode_record(json.dumps(fields)) == record


def test_geo_is_read() -> None:
    """The position of a track on the ground."""
    record = track_record(_frame(Tracks((_track(),))), source="a", published_ns=5)
    fields = json.loads(encode_record(record))
    fields["tracks"][0]["geo"] = {"lat": 48.1, "lon": 11.5, "error_m": 3.5}
    geo = decode_record(json.dumps(fields)).tracks[0].geo
    assert geo is not None
    assert (geo.lat, geo.lon, geo.error_m) == (48.1, 11.5, 3.5)


def test_ground_positions_are_written() -> None:
    """`geo` of a target below the camera with its error; none near the horizon or at an unknown height."""
    pose = Pose(
        48.1, 11.5, 600.0, heading=0.0, pitch=0.0, roll=0.0, sensor_angles=(0.0, -math.pi / 2, 0.0),
        field_of_view=(math.radians(178), 1.0),
    )  # fmt: skip
    frame = _frame(Tracks((_track(x=0.0, y=539.5), _track(id=8, x=959.5, y=539.5))), pose)
    record = track_record(frame, source="a", published_ns=5, ground_altitude_m=500.0)
    written = json.loads(encode_record(record))["tracks"]
    assert "geo" not in written[0]
    assert written[1]["geo"] == pytest.approx({"lat": 48.1, "lon": 11.5, "error_m": 3.47}, abs=1e-12)
    assert b'"geo"' not in encode_record(track_record(frame, source="a", published_ns=5))


def _changed(**changes: Any) -> bytes:
    record = track_record(_frame(Tracks((_track(),)), _registration(np.eye(3))), source="a", published_ns=5)
    return json.dumps({**json.loads(encode_record(record)), **changes}).encode()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{}",
        b"null",
        b"[1, 2]",
        b"\xff\xfe\x00",
        b'{"schema": "\xff"}',
        b"[" * 100_000,
        b'{"u": ' + b"[" * 100_000,
        b'{"u": ' + b"9" * 10_000 + b"}",
        _changed(schema="streamkit.tracks/2"),
        _changed(seq=-1),
        _changed(seq=1.5),
        _changed(seq=2**70),
        _changed(pts_ns=2**70),
        _changed(capture_origin="guess"),
        _changed(tracks=None),
        _changed(tracks=[{"id": 1}]),
        _changed(registration={"reference": 1, "status": "fine"}),
        _changed(registration={"reference": 1, "status": "ok", "to_reference": [[1, 2, 3]]}),
        _changed(age_ms="old"),
        _changed()[:-40],
        _changed() + b"x",
    ],
)
def test_invalid_records_are_refused(data: bytes) -> None:
    """With a StreamError."""
    with pytest.raises(StreamError, match="not a track record"):
        decode_record(data)


def test_the_error_names_the_field() -> None:
    """The path of the first wrong field is in the error."""
    with pytest.raises(StreamError, match=r"\$\.seq"):
        decode_record(_changed(seq="twelve"))


def test_records_are_immutable() -> None:
    """Attributes cannot be set."""
    record: TrackRecord = track_record(_frame(), source="a", published_ns=5)
    with pytest.raises(AttributeError):
        record.seq = 4  # type: ignore[misc]
    assert msgspec.structs.replace(record, seq=4).seq == 4


def test_every_registration_status_is_written_and_parsed() -> None:
    """As its word."""
    for status in RegistrationStatus:
        registration = Registration(np.eye(3), np.eye(3), status=status)
        record = track_record(_frame(registration), source="a", published_ns=5)
        assert json.loads(encode_record(record))["registration"]["status"] == status.value
        assert decode_record(encode_record(record)) == record
