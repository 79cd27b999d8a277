"""Frames from records: what zenohsrc makes of a received record."""

from functools import lru_cache

from streamkit import (
    TRACKS_CAPS,
    Caps,
    Detections,
    Frame,
    Pose,
    Registration,
    TrackRecord,
    Tracks,
    registration_of,
    tracks_of,
)


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
