"""Metadata of a scaled, cropped or flipped frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from streamkit.flow.frame import Frame
from streamkit.flow.metadata import Detections, GroundReference, Registration, Tracks
from streamkit.geometry.homography import FloatArray
from streamkit.geometry.scaling import scale_boxes, scale_homographies, scale_points
from streamkit.geometry.track import Provenance


def scale_metadata(frame: Frame, scaling: FloatArray, previous_scaling: FloatArray) -> Frame:
    """The frame with its registration, position, detections and tracks in pixels of the frame made of it.

    The reference plane is unchanged, and with it velocities of tracks and `reference_change`. Homographies
    that are not finite, other metadata, data and caps stay.

    Args:
        frame: with metadata in pixels before scaling.
        scaling: float64[3, 3], affine, maps pixels before to pixels after scaling, cropping or flipping, see
            `streamkit.geometry.scaling`.
        previous_scaling: the same for the previous frame.
    """
    changed: list[object] = []
    area = abs(float(np.linalg.det(scaling[:2, :2])))
    size = math.sqrt(area)
    if (registration := frame.get(Registration)) is not None:
        to_previous, to_reference = scale_homographies(
            scaling, previous_scaling, registration.to_previous, registration.to_reference
        )
        corner_std = None if registration.corner_std is None else registration.corner_std * size
        rmse = registration.rmse * size
        changed.append(
            replace(
                registration,
                to_previous=to_previous, to_reference=to_reference, rmse=rmse, corner_std=corner_std,
            )
        )  # fmt: skip
    if (ground := frame.get(GroundReference)) is not None:
        changed.append(replace(ground, to_local=ground.to_local @ np.linalg.inv(scaling)))
    if (detections := frame.get(Detections)) is not None:
        corners = scale_points(scaling, detections.boxes.reshape(-1, 2)).reshape(-1, 2, 2)
        boxes = np.hstack([corners.min(axis=1), corners.max(axis=1)])
        centroids = scale_points(scaling, detections.centroids)
        changed.append(replace(detections, centroids=centroids, boxes=boxes, areas=detections.areas * area))
    if (tracks := frame.get(Tracks)) is not None:
        changed.append(_scale_tracks(tracks, scaling))
    return frame.attach(*changed) if changed else frame


def _scale_tracks(item: Tracks, scaling: FloatArray) -> Tracks:
    rows = item.tracks
    values = np.array([row.turned_box for row in rows]).reshape(-1, 5)
    centres = scale_points(scaling, values[:, :2]).tolist()
    boxes = np.column_stack(scale_boxes(scaling, *values[:, 2:].T)).tolist()
    linear = scaling[:2, :2]
    return Tracks(
        tuple(
            replace(
                row, x=x, y=y, length=length, width=width, angle=angle,
                covariance=linear @ row.covariance @ linear.T,
                provenance=_scale_provenance(row.provenance, scaling),
            )
            for row, (x, y), (length, width, angle) in zip(rows, centres, boxes, strict=True)
        )
    )  # fmt: skip


def _scale_provenance(item: Provenance | None, scaling: FloatArray) -> Provenance | None:
    if item is None or item.predicted is None:
        return item
    x, y = scale_points(scaling, np.array([item.predicted]))[0].tolist()
    return replace(item, predicted=(x, y))
