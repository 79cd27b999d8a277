"""Between frames and their records."""

from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from streamkit import (
    Caps,
    Capture,
    Frame,
    Pose,
    Registration,
    Track,
    TrackRecord,
    Tracks,
    decode_record,
    encode_record,
    track_record,
)
from streamkit_zenoh.wire.georeference import Camera, ground_places

TRACKS_NAME = "application/x-tracks"
TRACKS_SCHEMA = "streamkit.tracks/1"
TRACKS_CAPS = Caps(TRACKS_NAME)
UNKNOWN = float("nan")


def payload_of(
    frame: Frame, source: str, published_ns: int | None, dropped: int, *, provenance: bool = False
) -> bytes:
    """The record of a frame as one line of JSON; a frame that is a record passes as it is.

    Raises:
        ValueError: a track has no place.
        StreamError: the frame says that it is a record, and is none.
    """
    if frame.caps.name != TRACKS_NAME:
        record = track_record(
            frame, source=source, published_ns=published_ns, dropped=dropped, provenance=provenance
        )
        return encode_record(record)
    data = bytes(frame.data)
    record = decode_record(data)
    return encode_record(record) if b"\n" in data else data


def record_of(
    frame: Frame,
    source: str,
    published_ns: int | None,
    dropped: int,
    ground_altitude_m: float | None = None,
    *,
    provenance: bool = False,
) -> TrackRecord:
    """The record of a frame; a frame that is a record gives that.

    With the altitude of the ground, targets have their places on it where the frame has a pose.

    Raises:
        ValueError: a track has no place.
        StreamError: the frame says that it is a record, and is none.
    """
    if frame.caps.name == TRACKS_NAME:
        return decode_record(frame.data)
    places = None if ground_altitude_m is None else _places(frame, ground_altitude_m)
    return track_record(
        frame,
        source=source,
        published_ns=published_ns,
        dropped=dropped,
        places=places,
        provenance=provenance,
    )


def plain_record(
    frame: Frame, source: str, published_ns: int | None, ground_altitude_m: float | None
) -> dict[str, Any]:
    """The record of a frame as JSON has it, with numbers and words only."""
    fields: dict[str, Any] = msgspec.to_builtins(record_of(frame, source, published_ns, 0, ground_altitude_m))
    return fields


def _places(frame: Frame, ground_altitude_m: float) -> dict[int, tuple[float, float, float | None]]:
    pose, tracks = frame.get(Pose), frame.get(Tracks)
    if pose is None or tracks is None or not tracks.tracks or pose.is_stale:
        return {}
    if pose.altitude is None or pose.heading is None or pose.field_of_view is None:
        return {}
    width, height = frame.caps.get("width"), frame.caps.get("height")
    if not (isinstance(width, int) and isinstance(height, int)):
        return {}
    camera = Camera(
        pose.latitude,
        pose.longitude,
        pose.altitude - ground_altitude_m,
        (pose.heading, pose.pitch or 0.0, pose.roll or 0.0),
        pose.sensor_angles or (0.0, 0.0, 0.0),
        pose.field_of_view,
        (width, height),
    )
    found = ground_places(camera, np.array([(track.x, track.y) for track in tracks.tracks]))
    return {
        track.id: (float(latitude), float(longitude), None)
        for track, (latitude, longitude) in zip(tracks.tracks, found, strict=True)
        if np.isfinite(latitude)
    }


def essence(frame: Frame) -> Frame:
    """The frame with only what its record needs: pictures that wait to be sent would fill the memory."""
    if frame.caps.name == TRACKS_NAME:
        return frame
    found = frame.metadata
    kept: dict[type, object] = {kind: found[kind] for kind in (Tracks, Registration, Pose) if kind in found}
    return Frame(
        b"", frame.caps, pts=frame.pts, epoch=frame.epoch, seq=frame.seq, capture=frame.capture, metadata=kept
    )


def frame_of(payload: bytes, arrival_ns: int, epoch: int = 0) -> Frame:
    """A frame that carries a record in JSON: see `record_frame`.

    Raises:
        StreamError: it is no record.
    """
    return record_frame(decode_record(payload), payload, arrival_ns, epoch)


def record_frame(record: TrackRecord, payload: bytes, arrival_ns: int, epoch: int = 0) -> Frame:
    """A frame that carries a record: its JSON, its times, and Tracks and Registration as metadata.

    What a record does not say is NaN: a velocity, a covariance, and always the homography to the previous
    frame, which records have not.

    Args:
        record: the record.
        payload: the same as JSON.
        arrival_ns: monotonic clock.
        epoch: added to the record's own.
    """
    frame = Frame(
        payload,
        _caps(record.width, record.height),
        pts=record.pts_ns,
        epoch=epoch + record.epoch,
        seq=record.seq,
        arrival_ns=arrival_ns,
        capture=capture_of(record),
    ).attach(tracks_of(record))
    registration = _registration(record)
    return frame if registration is None else frame.attach(registration)


def capture_of(record: TrackRecord) -> Capture | None:
    """When the frame was captured, where the record says so."""
    if record.capture_ns is None or record.capture_origin is None:
        return None
    return Capture(record.capture_ns, record.capture_origin)


@lru_cache(maxsize=64)
def _caps(width: int | None, height: int | None) -> Caps:
    size = {name: value for name, value in (("width", width), ("height", height)) if value is not None}
    return TRACKS_CAPS.with_fields(**size)


def tracks_of(record: TrackRecord) -> Tracks:
    """The targets of a record as metadata."""
    return Tracks(
        tuple(
            Track(
                id=target.id,
                state=target.state,
                x=target.x,
                y=target.y,
                length=target.length,
                width=target.width,
                angle=target.angle,
                velocity=(
                    UNKNOWN if target.vx is None else target.vx,
                    UNKNOWN if target.vy is None else target.vy,
                ),
                covariance=np.array(target.position_covariance or np.full((2, 2), UNKNOWN)),
                score=target.score,
                age_ns=target.age_ns,
            )
            for target in record.tracks
        )
    )


def _registration(record: TrackRecord) -> Registration | None:
    if record.registration is None:
        return None
    unknown = np.full((3, 3), UNKNOWN)
    return Registration(
        to_previous=unknown,
        to_reference=np.array(record.registration.to_reference or unknown),
        reference=record.registration.reference,
        status=record.registration.status,
    )
