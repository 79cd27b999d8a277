"""Metadata of frames from track records: the way back from `track_record`."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from streamkit.flow.frame import Frame
from streamkit.flow.metadata import Registration, Tracks
from streamkit.flow.record import TargetRecord, TrackRecord
from streamkit.geometry.track import Track

UNKNOWN = float("nan")
# Fields that a target has in its record and in the metadata.
SAME_FIELDS = ("id", "state", "x", "y", "length", "width", "angle", "score", "age_ns")


def tracks_of(record: TrackRecord) -> Tracks:
    """The targets of a record as metadata; unknown velocities and covariances are NaN."""
    return Tracks(tuple(_track(target) for target in record.tracks))


def attach_record(frame: Frame, record: TrackRecord) -> Frame:
    """The frame with the tracks of a record and, where it has one, its registration."""
    frame = frame.attach(tracks_of(record))
    return frame if record.registration is None else frame.attach(registration_of(record.registration))


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
