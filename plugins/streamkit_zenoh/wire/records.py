"""Frames from records: what zenohsrc makes of a received record."""

from functools import lru_cache

import numpy as np

from streamkit import TRACKS_CAPS, Caps, Capture, Frame, Pose, Registration, Track, TrackRecord, Tracks

TRACKS_SCHEMA = "streamkit.tracks/1"
UNKNOWN = float("nan")


def without_pixels(frame: Frame) -> Frame:
    """The frame with only what its record needs, so that a queue of frames holds no pixels."""
    if frame.caps.name == TRACKS_CAPS.name:
        return frame
    found = frame.metadata
    kept: dict[type, object] = {kind: found[kind] for kind in (Tracks, Registration, Pose) if kind in found}
    return Frame(
        b"", frame.caps, pts=frame.pts, epoch=frame.epoch, seq=frame.seq, capture=frame.capture, metadata=kept
    )


def record_frame(record: TrackRecord, payload: bytes, arrival_ns: int, epoch: int = 0) -> Frame:
    """A frame that carries a record: its JSON, its times, and Tracks and Registration as metadata.

    Unknown velocities and covariances are NaN, and so is the homography to the previous frame, which records
    do not hold.

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
    """Time of capture and its origin; None where the record lacks either."""
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
        corner_std=record.registration.corner_std,
    )
