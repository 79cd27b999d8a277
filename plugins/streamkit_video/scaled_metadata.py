"""Metadata in pixels, carried over to a scaled frame."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from streamkit import Detections, Frame, Registration, Track, Tracks
from streamkit_video.dronetestsrc.truth import TrueRegistration, TrueTargets

FloatArray = NDArray[np.float64]


def scale_metadata(frame: Frame, scaling: FloatArray, previous_scaling: FloatArray) -> Frame:
    """The frame with its registration, detections, tracks and truth in pixels of the scaled picture.

    The reference plane stays as it is, so that velocities on it and `reference_change` do, too. Other
    metadata passes unchanged.

    Args:
        frame: with metadata in pixels before scaling.
        scaling: float64[3, 3], pixels before to pixels after scaling: axis-parallel.
        previous_scaling: the same for the frame before this one.
    """
    changed: list[object] = []
    for item in frame.metadata.values():
        if isinstance(item, Registration):
            changed.append(_registration(item, scaling, previous_scaling))
        elif isinstance(item, Detections):
            changed.append(_detections(item, scaling))
        elif isinstance(item, Tracks):
            changed.append(Tracks(tuple(_track(track, scaling) for track in item.tracks)))
        elif isinstance(item, TrueRegistration):
            back = np.linalg.inv(scaling)
            to_previous = previous_scaling @ item.to_previous @ back
            changed.append(TrueRegistration(_scaled(to_previous), _scaled(item.to_reference @ back)))
        elif isinstance(item, TrueTargets):
            changed.append(_true_targets(item, scaling))
    return frame.attach(*changed) if changed else frame


def _registration(item: Registration, scaling: FloatArray, previous_scaling: FloatArray) -> Registration:
    back = np.linalg.inv(scaling)
    return dataclasses.replace(
        item,
        to_previous=_scaled(previous_scaling @ item.to_previous @ back),
        to_reference=_scaled(item.to_reference @ back),
        rmse=item.rmse * math.sqrt(scaling[0, 0] * scaling[1, 1]),
    )


def _scaled(homography: FloatArray) -> FloatArray:
    return np.asarray(homography / homography[2, 2])


def _moved(points: FloatArray, scaling: FloatArray) -> FloatArray:
    return np.asarray(points * np.diag(scaling)[:2] + scaling[:2, 2])


def _detections(item: Detections, scaling: FloatArray) -> Detections:
    boxes = _moved(item.boxes.reshape(-1, 2), scaling).reshape(-1, 4)
    areas = item.areas * scaling[0, 0] * scaling[1, 1]
    return dataclasses.replace(item, centroids=_moved(item.centroids, scaling), boxes=boxes, areas=areas)


def _track(track: Track, scaling: FloatArray) -> Track:
    across, down = float(scaling[0, 0]), float(scaling[1, 1])
    cos, sin = math.cos(track.angle), math.sin(track.angle)
    stretch = np.diag([across, down])
    return dataclasses.replace(
        track,
        x=track.x * across + float(scaling[0, 2]),
        y=track.y * down + float(scaling[1, 2]),
        length=track.length * math.hypot(across * cos, down * sin),
        width=track.width * math.hypot(across * sin, down * cos),
        angle=math.atan2(down * sin, across * cos),
        covariance=stretch @ track.covariance @ stretch,
    )


def _true_targets(item: TrueTargets, scaling: FloatArray) -> TrueTargets:
    across, down = float(scaling[0, 0]), float(scaling[1, 1])
    cos, sin = np.cos(item.angles), np.sin(item.angles)
    return TrueTargets(
        ids=item.ids,
        centres=_moved(item.centres, scaling),
        lengths=item.lengths * np.hypot(across * cos, down * sin),
        widths=item.widths * np.hypot(across * sin, down * cos),
        angles=np.arctan2(down * sin, across * cos),
        velocities=item.velocities * (across, down),
    )
