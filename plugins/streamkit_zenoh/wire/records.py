"""Frames from records: what zenohsrc makes of a received record."""

from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from streamkit import (
    TRACKS_CAPS,
    Caps,
    Detections,
    Frame,
    Pose,
    Registration,
    TargetRecord,
    Track,
    TrackRecord,
    Tracks,
)

TRACKS_SCHEMA = "streamkit.tracks/1"
UNKNOWN = float("nan")
# Fields that a target has in its record and in the metadata.
SAME_FIELDS = ("id", "state", "x", "y", "length", "width", "angle", "score", "age_ns")


def without_pixels(frame: Frame) -> Frame:
    """The frame with only what its record needs, so that a queue of frames holds no pixels."""
    if frame.caps.name == TRACKS_CAPS.name:
        return frame
    wanted: tuple[type, ...] = (Tracks, Registration, Pose, Detections)
    kept = {kind: item for kind, item in frame.metadata.items() if kind in wanted}
    return Frame(
        b"", frame.caps, pts=frame.pts, epoch=frame.epoch, seq=frame.seq, capture=frame.capture, metadata=kept
    )


def record_frame(record: TrackRecord, payload: bytes, arrival_ns: int, epoch: int = 0) -> Frame:
    """A frame that carries a record: its JSON, its times, and Tracks and Registration as metadata.

    Unknown velocities and covariances are NaN, and so is the homography to the previous frame, which records
    do not hold. `payload` is the record as JSON; `epoch` is added to the record's own.
    """
    frame = Frame(
        payload, _caps(record.width, record.height), pts=record.pts_ns, epoch=epoch + record.epoch,
        seq=record.seq, arrival_ns=arrival_ns, capture=record.capture,
    ).attach(tracks_of(record))  # fmt: skip
    return frame if record.registration is None else frame.attach(registration_of(record.registration))


@lru_cache(maxsize=64)
def _caps(width: int | None, height: int | None) -> Caps:
    size = {name: value for name, value in (("width", width), ("height", height)) if value is not None}
    return TRACKS_CAPS.with_fields(**size)


def tracks_of(record: TrackRecord) -> Tracks:
    """The targets of a record as metadata."""
    return Tracks(tuple(_track(target) for target in record.tracks))


def _track(target: TargetRecord) -> Track:
    fields: dict[str, Any] = {name: getattr(target, name) for name in SAME_FIELDS}
    vx, vy = (UNKNOWN if part is None else part for part in (target.vx, target.vy))
    covariance = np.array(target.position_covariance or np.full((2, 2), UNKNOWN))
    return Track(**fields, velocity=(vx, vy), covariance=covariance)


def registration_of(record: msgspec.Struct) -> Registration:
    """The registration with the fields of a record; unknown numbers and matrices are NaN."""
    unknown = np.full((3, 3), UNKNOWN)
    fields: dict[str, Any] = {"to_previous": unknown, "to_reference": unknown, "rmse": UNKNOWN}
    for name, value in msgspec.structs.asdict(record).items():
        if value is not None:
            fields[name] = np.array(value) if isinstance(value, tuple) else value
    return Registration(**fields)
