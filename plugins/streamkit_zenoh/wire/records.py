"""Frames from records: what zenohsrc makes of a received record."""

from functools import lru_cache

from streamkit import TRACKS_CAPS, Caps, Frame, TrackRecord, attach_record


def record_frame(record: TrackRecord, payload: bytes, arrival_ns: int, epoch: int) -> Frame:
    """A frame that carries a record: its JSON, its times, and Tracks and Registration as metadata.

    Unknown velocities and covariances are NaN, and so is the homography to the previous frame, which records
    do not hold. `payload` is the record as JSON; `epoch` is added to the record's own.
    """
    frame = Frame(
        payload, _caps(record.width, record.height), pts=record.pts_ns, epoch=epoch + record.epoch,
        seq=record.seq, arrival_ns=arrival_ns, capture=record.capture,
    )  # fmt: skip
    return attach_record(frame, record)


@lru_cache(maxsize=64)
def _caps(width: int | None, height: int | None) -> Caps:
    size = {name: value for name, value in (("width", width), ("height", height)) if value is not None}
    return TRACKS_CAPS.with_fields(**size)
