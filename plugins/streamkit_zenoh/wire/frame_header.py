"""The header of an image: the frame's record, and the metadata that a record does not hold."""

from __future__ import annotations

import math
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from streamkit import (
    Detections,
    Frame,
    Pose,
    Registration,
    RegistrationStatus,
    TrackRecord,
    raw_video_caps,
    registration_of,
    scale_metadata,
    track_record,
    tracks_of,
)
from streamkit.geometry.scaling import scaling_homography
from streamkit_zenoh.wire.encodings import decode_json

FRAME_SCHEMA: Literal["streamkit.frame/1"] = "streamkit.frame/1"
# Largest width and height in a header: more than any sensor has.
SIDE_LIMIT_PX = 32_768

FloatArray = NDArray[np.float64]
Row3 = tuple[float, float, float]
Matrix3 = tuple[Row3, Row3, Row3]


class DetectionRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A detection, in pixels of the frame: see `streamkit.Detections`."""

    centroid: tuple[float, float]
    bbox: tuple[float, float, float, float]
    area: float
    score: float
    label: str | None = None


class MotionRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A registration: see `streamkit.Registration`; unknown matrices are left out."""

    reference: int
    status: RegistrationStatus
    to_previous: Matrix3 | None = None
    to_reference: Matrix3 | None = None
    reference_change: Matrix3 | None = None
    keyframe: bool = False
    matches: int = 0
    inliers: int = 0
    rmse: float | None = None
    corner_std: float | None = None


class FrameHeader(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The second line of an image's attachment, as JSON; in pixels of the frame before scaling.

    Attributes:
        schema: name and version of the schema.
        record: times, size and tracks of the frame.
        format: GRAY8 or BGR, to which the image decodes.
        picture_width: width of the image, px; that of the frame is in `record`.
        picture_height: height of the image, px.
        duration_ns: of the frame.
        motion: its registration.
        detections: None without a detector.
        are_objects: whether each detection is one whole object: see `streamkit.Detections`.
        pose: the fields of `streamkit.Pose`.
    """

    schema: Literal["streamkit.frame/1"]
    record: TrackRecord
    format: Literal["GRAY8", "BGR"]
    picture_width: int
    picture_height: int
    duration_ns: int | None = None
    motion: MotionRecord | None = None
    detections: tuple[DetectionRecord, ...] | None = None
    are_objects: bool = False
    pose: dict[str, Any] | None = None


def frame_header(frame: Frame, source: str, published_ns: int, dropped: int, shape: tuple[int, ...]) -> bytes:
    """Encodes the header of a frame whose image has this array shape."""
    registration, detections, pose = frame.get(Registration), frame.get(Detections), frame.get(Pose)
    header = FrameHeader(
        schema=FRAME_SCHEMA,
        record=track_record(frame, source=source, published_ns=published_ns, dropped=dropped),
        format="GRAY8" if len(shape) == 2 else "BGR",
        picture_width=shape[1],
        picture_height=shape[0],
        duration_ns=frame.duration,
        motion=None if registration is None else _motion_record(registration),
        detections=None if detections is None else _detection_records(detections),
        are_objects=detections is not None and detections.are_objects,
        pose=None if pose is None else msgspec.to_builtins(pose),
    )
    return msgspec.json.encode(header)


def read_header(data: bytes) -> FrameHeader:
    """Decodes and validates a header.

    Raises:
        ValueError: it is invalid.
    """
    header = decode_json(data, FrameHeader)
    sides = (header.picture_width, header.picture_height, header.record.width, header.record.height)
    if any(side is not None and not 0 < side <= SIDE_LIMIT_PX for side in sides):
        raise ValueError(f"sides must be 1 to {SIDE_LIMIT_PX} px, got {sides}")
    return header


def image_frame(image: NDArray[np.uint8], header: FrameHeader, arrival_ns: int, epoch: int) -> Frame:
    """The frame with this image, its metadata in pixels of the image.

    Raises:
        ValueError: the pose is invalid.
    """
    record = header.record
    height, width = image.shape[:2]
    scaling = scaling_homography((record.width or width, record.height or height), (width, height))
    frame = Frame(
        image, raw_video_caps("GRAY8" if image.ndim == 2 else "BGR", width, height, None), pts=record.pts_ns,
        duration=header.duration_ns, epoch=epoch + record.epoch, seq=record.seq, arrival_ns=arrival_ns,
        capture=record.capture,
    )  # fmt: skip
    items: list[object] = [tracks_of(record)] if record.tracks else []
    if header.motion is not None:
        items.append(registration_of(header.motion))
    if header.detections is not None:
        items.append(_detections_of(header.detections, header.are_objects))
    if header.pose is not None:
        items.append(msgspec.convert(header.pose, Pose))
    return scale_metadata(frame.attach(*items), scaling, scaling) if items else frame


def _motion_record(item: Registration) -> MotionRecord:
    fields = msgspec.to_builtins(item, enc_hook=_finite_rows)
    if not math.isfinite(item.rmse):
        fields["rmse"] = None
    return msgspec.convert(fields, MotionRecord)


def _finite_rows(matrix: FloatArray) -> list[list[float]] | None:
    return matrix.tolist() if np.isfinite(matrix).all() else None


def _detection_records(item: Detections) -> tuple[DetectionRecord, ...]:
    columns = (column.tolist() for column in (item.centroids, item.boxes, item.areas, item.scores))
    labels = item.labels or (None,) * len(item)
    names = DetectionRecord.__struct_fields__
    rows = [dict(zip(names, row, strict=True)) for row in zip(*columns, labels, strict=True)]
    return msgspec.convert(rows, tuple[DetectionRecord, ...])


def _detections_of(rows: tuple[DetectionRecord, ...], are_objects: bool) -> Detections:
    labels = tuple(row.label or "" for row in rows)
    return Detections(
        centroids=np.array([row.centroid for row in rows], dtype=np.float64).reshape(-1, 2),
        boxes=np.array([row.bbox for row in rows], dtype=np.float64).reshape(-1, 4),
        areas=np.array([row.area for row in rows], dtype=np.float64),
        scores=np.array([row.score for row in rows], dtype=np.float64),
        labels=labels if any(labels) else (),
        are_objects=are_objects,
    )
