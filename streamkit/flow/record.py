"""The track record: one JSON object per frame, on zenoh and as a line of a .jsonl file."""

from __future__ import annotations

from math import isfinite
from typing import Annotated, Literal, cast

import msgspec

from streamkit.errors import StreamError
from streamkit.flow.caps import Caps
from streamkit.flow.frame import Capture, Frame
from streamkit.flow.ground import GroundPosition, ground_positions
from streamkit.flow.metadata import Detections, Registration
from streamkit.geometry.boxes import upright_sides
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit.geometry.track import Track, TrackState
from streamkit.masking import mask_secrets

TRACKS_SCHEMA: Literal["streamkit.tracks/1"] = "streamkit.tracks/1"
# Caps of frames whose data is a record in JSON.
TRACKS_CAPS = Caps("application/x-tracks")
MAX_AGE_NS = 24 * 3600 * 10**9  # no live stream is delayed by a day

Natural = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
Nanoseconds = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
Row2 = tuple[float, float]
Row3 = tuple[float, float, float]


class RegistrationRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Registration of the frame: see `streamkit.Registration`.

    Attributes:
        to_reference: rows of the 3x3 matrix; None if unknown.
        matches, inliers, rmse: only with provenance.
        corner_std: predicted error at the frame's worst corner, px.
    """

    reference: int
    to_reference: tuple[Row3, Row3, Row3] | None = None
    status: RegistrationStatus
    matches: int | None = None
    inliers: int | None = None
    rmse: float | None = None
    corner_std: float | None = None


class GeoRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Position of a target on the ground: WGS84 degrees, and error radius in m."""

    lat: float
    lon: float
    error_m: float | None = None


class MatchRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The detection associated with a target, px of the frame.

    Attributes:
        row: of the detection in its frame.
        gate: distance from the prediction, standard deviations.
    """

    row: int
    gate: float | None = None
    centroid: Row2
    bbox: tuple[float, float, float, float]
    area: float
    score: float
    label: str | None = None


class ProvenanceRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How a target was updated: see `streamkit.Provenance`."""

    predicted: Row2 | None = None
    detection: MatchRecord | None = None
    shared: bool = False
    similarity: float | None = None
    learnt: bool = False
    cause: str | None = None


class TargetRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One target: pixels of the frame, radians from +x towards +y, px/s on the reference plane.

    Attributes:
        bbox: x0 y0 x1 y1, axis-aligned bounds of the rotated rectangle; may exceed the frame.
        vx, vy, position_covariance, geo: None if unknown.
        provenance: in files only.
    """

    id: int
    state: TrackState
    x: float
    y: float
    length: float
    width: float
    angle: float
    bbox: tuple[float, float, float, float]
    vx: float | None = None
    vy: float | None = None
    position_covariance: tuple[Row2, Row2] | None = None
    score: float
    age_ns: Nanoseconds
    geo: GeoRecord | None = None
    provenance: ProvenanceRecord | None = None


class TrackRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The tracks of one frame; None is unknown and omitted from the JSON.

    Attributes:
        schema: name and version of the format.
        source: publisher, for example the key `uav/1`.
        seq: number of the frame at its source; a gap is a frame without a record.
        epoch: increases when `pts_ns` restarts.
        capture_ns: UTC of capture.
        capture_origin: rtcp, misb, file or arrival.
        published_ns: UTC of the record.
        age_ms: from capture to publishing; None for a recording (misb or file, over a day ago).
        width, height: of the frame, px.
        tracks: in order of their ids.
        dropped: records that the publisher could not deliver so far.
    """

    schema: Literal["streamkit.tracks/1"]
    source: str
    seq: Natural
    epoch: Natural
    pts_ns: Nanoseconds | None = None
    capture_ns: Nanoseconds | None = None
    capture_origin: Literal["rtcp", "misb", "file", "arrival"] | None = None
    published_ns: Nanoseconds | None = None
    age_ms: float | None = None
    width: Natural | None = None
    height: Natural | None = None
    registration: RegistrationRecord | None = None
    tracks: tuple[TargetRecord, ...]
    dropped: Natural

    @property
    def capture(self) -> Capture | None:
        """Time of capture and its origin; None where either is unknown."""
        if self.capture_ns is None or self.capture_origin is None:
            return None
        return Capture(self.capture_ns, self.capture_origin)


_ENCODER = msgspec.json.Encoder()
_DECODER = msgspec.json.Decoder(TrackRecord)


def track_record(
    frame: Frame,
    *,
    source: str,
    published_ns: int | None,
    dropped: int = 0,
    ground_altitude_m: float | None = None,
    provenance: bool = False,
) -> TrackRecord:
    """The record of a frame, from its `Tracks` and `Registration`; the one in its data with `TRACKS_CAPS`.

    Args:
        frame: any frame; without `Tracks` the record has no targets.
        source: publisher; its secrets are masked.
        published_ns: UTC now, ns; None omits it and the age.
        dropped: records lost so far.
        ground_altitude_m: altitude of the ground, m, with the datum of the pose; None to take it from there.
        provenance: whether to include how each row was computed, and the quality of the registration.

    Raises:
        ValueError: a track's position, size, angle or score is not finite.
        StreamError: the frame has `TRACKS_CAPS`, and its data is no record.
    """
    if frame.caps.name == TRACKS_CAPS.name:
        return decode_record(frame.data)
    capture, registration = frame.capture, frame.get(Registration)
    detections = frame.get(Detections) if provenance else None
    positions, _ = ground_positions(frame, ground_altitude_m)
    return TrackRecord(
        schema=TRACKS_SCHEMA,
        source=mask_secrets(source),
        seq=frame.seq,
        epoch=frame.epoch,
        pts_ns=frame.pts,
        capture_ns=capture.utc_ns if capture else None,
        capture_origin=capture.origin if capture else None,
        published_ns=published_ns,
        age_ms=_age_ms(capture, published_ns),
        width=_pixels(frame, "width"),
        height=_pixels(frame, "height"),
        registration=_registration_record(registration, provenance) if registration else None,
        tracks=tuple(
            _target_record(
                track, positions.get(track.id), _provenance_record(track, detections) if provenance else None
            )
            for track in frame.tracks
        ),
        dropped=dropped,
    )


def encode_record(record: TrackRecord) -> bytes:
    """One line of JSON in UTF-8, without a line break."""
    return _ENCODER.encode(record)


def decode_record(data: bytes | bytearray | memoryview | str) -> TrackRecord:
    """Decodes a record; unknown fields are ignored.

    Raises:
        StreamError: the data is not a record of this schema; names the field.
    """
    try:
        return _DECODER.decode(data)
    except (ValueError, RecursionError) as error:
        size = len(data) if isinstance(data, str) else memoryview(data).nbytes
        raise StreamError(f"not a track record ({TRACKS_SCHEMA}): {error} [{size} bytes]") from None


def record_line(frame: Frame) -> bytes:
    """The record in the data of a frame with `TRACKS_CAPS`, on one line and otherwise unchanged.

    It keeps unknown fields, and publisher, times, age and provenance of the first sender.

    Raises:
        StreamError: the data is no record.
    """
    data = bytes(frame.data)
    decode_record(data)
    return msgspec.json.format(data, indent=-1) if b"\n" in data else data


def _age_ms(capture: Capture | None, published_ns: int | None) -> float | None:
    """Time from capture to publishing, ms; None if unknown, or if the frame is of a recording."""
    if capture is None or published_ns is None:
        return None
    age_ns = published_ns - capture.utc_ns
    is_recorded = capture.origin in ("misb", "file") and age_ns > MAX_AGE_NS
    return None if is_recorded else round(age_ns / 1e6, 3)


def _pixels(frame: Frame, field: str) -> int | None:
    value = frame.caps.get(field)
    return value if isinstance(value, int) else None


def _finite(*numbers: float) -> tuple[float, ...] | None:
    """Numbers as floats; None unless all are finite."""
    return tuple(map(float, numbers)) if all(map(isfinite, numbers)) else None


def _registration_record(registration: Registration, provenance: bool) -> RegistrationRecord:
    rows = [_finite(*row) for row in registration.to_reference.tolist()]
    std = _finite_or_none(registration.corner_std)
    found = RegistrationRecord(
        reference=int(registration.reference),
        to_reference=None if None in rows else cast("tuple[Row3, Row3, Row3]", tuple(rows)),
        status=registration.status,
        corner_std=None if std is None else round(std, 3),
    )
    if not provenance:
        return found
    rmse = _finite_or_none(registration.rmse)
    matches, inliers = int(registration.matches), int(registration.inliers)
    return msgspec.structs.replace(found, matches=matches, inliers=inliers, rmse=rmse)


def _target_record(
    track: Track, position: GroundPosition | None, provenance: ProvenanceRecord | None
) -> TargetRecord:
    place = track.x, track.y, track.length, track.width, track.angle, track.score
    if (known := _finite(*place)) is None:
        raise ValueError(
            f"track {track.id}: x, y, length, width, angle and score must be finite, got "
            f"{', '.join(f'{value:g}' for value in place)}; end a track whose place is not known"
        )
    x, y, length, width, angle, score = known
    vx, vy = _finite(*track.velocity) or (None, None)
    spread = _finite(*track.covariance.ravel())
    across, down = upright_sides(length, width, angle)
    return TargetRecord(
        id=int(track.id), state=track.state, x=x, y=y, length=length, width=width, angle=angle,
        bbox=(x - across / 2, y - down / 2, x + across / 2, y + down / 2),
        vx=vx, vy=vy,
        position_covariance=None if spread is None else ((spread[0], spread[1]), (spread[2], spread[3])),
        score=score,
        age_ns=int(track.age_ns),
        geo=position and GeoRecord(lat=position[0], lon=position[1], error_m=round(position[2], 2)),
        provenance=provenance,
    )  # fmt: skip


def _provenance_record(track: Track, detections: Detections | None) -> ProvenanceRecord | None:
    known = track.provenance
    if known is None:
        return None
    row, match = known.detection, None
    if row is not None and detections is not None and row < len(detections):
        match = _match_record(detections, row, known.gate)
    return ProvenanceRecord(
        predicted=cast("Row2 | None", known.predicted and _finite(*known.predicted)),
        detection=match,
        shared=known.shared,
        similarity=_finite_or_none(known.similarity),
        learnt=known.learnt,
        cause=known.cause or None,
    )


def _match_record(detections: Detections, row: int, gate: float | None) -> MatchRecord:
    return MatchRecord(
        row=row,
        gate=_finite_or_none(gate),
        centroid=tuple(detections.centroids[row].tolist()),
        bbox=tuple(detections.boxes[row].tolist()),
        area=float(detections.areas[row]),
        score=float(detections.scores[row]),
        label=detections.labels[row] if detections.labels else None,
    )


def _finite_or_none(value: float | None) -> float | None:
    return None if value is None or not isfinite(value) else float(value)
