"""videoscale: scales raw video, and its metadata with it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from typing_extensions import override

from streamkit import (
    Caps,
    Detections,
    Frame,
    IntRange,
    NotNegotiated,
    Property,
    Registration,
    Track,
    Tracks,
    Transform,
)
from streamkit.geometry.homography import FloatArray, normalised
from streamkit_video.dronetestsrc.truth import TrueRegistration, TrueTargets
from streamkit_video.pixel_formats import FORMATS, PLANAR, odd_size_error, supports_size
from streamkit_video.scaling import ScaleMethod, Size, scale_image, scaling_homography

LARGEST_SIDE = 32767
"""Limit of OpenCV's resize, px."""


class VideoScale(Transform):
    """Scales raw video to the size that the caps after it ask for.

    Frames pass unchanged where no size is asked for. Where only the width or the height is given, the other
    follows in proportion. Registration, detections and tracks are scaled with the frame.

    Example:
        videotestsrc num-buffers=5 ! videoscale ! video/x-raw, width=160, height=120 ! fakesink
    """

    sink = src = (
        f"video/x-raw, format={{ {', '.join(FORMATS)} }}, "
        f"width=[ 1, {LARGEST_SIDE} ], height=[ 1, {LARGEST_SIDE} ]"
    )

    method: ScaleMethod = Property(
        ScaleMethod.LINEAR,
        live=True,
        doc="Interpolation; bilinear2 averages and is best for strong shrinking.",
    )

    @override
    def start(self) -> None:
        self._before: Size = (0, 0)
        self._after: Size = (0, 0)
        self._scaling = self._previous_scaling = scaling_homography((1, 1), (1, 1))

    @override
    def transform_caps(self, caps: Caps, direction: str) -> Caps:
        if caps.is_any:
            return self.pads["sink"].template.caps
        side = IntRange(1, LARGEST_SIDE)
        return caps | caps.with_fields(width=side, height=side)

    @override
    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps:
        """The sink's size if allowed, else the nearest, in proportion where only one side is given."""
        same = allowed & sink_caps
        if not same.is_empty:
            return same.fixate()
        caps = allowed.fixate(near=sink_caps)
        step = 2 if sink_caps["format"] in PLANAR else 1
        for free, given in (("width", "height"), ("height", "width")):
            if isinstance(allowed.get(free), IntRange) and not isinstance(allowed.get(given), IntRange):
                side = sink_caps.integer(free) * caps.integer(given) / sink_caps.integer(given)
                side = max(step, round(side / step) * step)
                caps = allowed.fixate(near=sink_caps.with_fields(**{free: side}))
        return caps

    @override
    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        self._before = (sink_caps.integer("width"), sink_caps.integer("height"))
        self._after = (src_caps.integer("width"), src_caps.integer("height"))
        self._format = str(src_caps["format"])
        for size in (self._before, self._after):
            if self._before != self._after and not supports_size(self._format, *size):
                raise NotNegotiated(f"{self.name}: {odd_size_error(self._format, *size)}")
        self._scaling = scaling_homography(self._before, self._after)

    @override
    def transform(self, frame: Frame) -> Frame:
        previous, self._previous_scaling = self._previous_scaling, self._scaling
        if self._before == self._after:
            return frame
        data = scale_image(frame.data, self._format, self._after, self.method)
        if frame.metadata:
            frame = scale_metadata(frame, self._scaling, previous)
        return frame.replace(data=data, caps=self.src_caps)


def scale_metadata(frame: Frame, scaling: FloatArray, previous_scaling: FloatArray) -> Frame:
    """The frame with registration, detections, tracks and ground truth in pixels of the scaled frame.

    The reference plane is unchanged, and with it velocities of tracks and `reference_change`. Other metadata
    passes unchanged.

    Args:
        frame: with metadata in pixels before scaling.
        scaling: float64[3, 3], maps pixels before to pixels after scaling: axis-parallel.
        previous_scaling: the same for the previous frame.
    """
    inverse = np.linalg.inv(scaling)
    changed: list[object] = []
    for item in frame.metadata.values():
        if isinstance(item, Registration | TrueRegistration):
            to_previous = normalised(previous_scaling @ item.to_previous @ inverse)
            to_reference = normalised(item.to_reference @ inverse)
            scaled = dataclasses.replace(item, to_previous=to_previous, to_reference=to_reference)
            if isinstance(scaled, Registration):
                rmse = scaled.rmse * math.sqrt(scaling[0, 0] * scaling[1, 1])
                scaled = dataclasses.replace(scaled, rmse=rmse)
            changed.append(scaled)
        elif isinstance(item, Detections):
            boxes = _scale_points(item.boxes.reshape(-1, 2), scaling).reshape(-1, 4)
            centroids = _scale_points(item.centroids, scaling)
            areas = item.areas * scaling[0, 0] * scaling[1, 1]
            changed.append(dataclasses.replace(item, centroids=centroids, boxes=boxes, areas=areas))
        elif isinstance(item, Tracks):
            changed.append(Tracks(tuple(_scale_track(track, scaling) for track in item.tracks)))
        elif isinstance(item, TrueTargets):
            changed.append(_scale_true_targets(item, scaling))
    return frame.attach(*changed) if changed else frame


def _scale_points(points: FloatArray, scaling: FloatArray) -> FloatArray:
    return np.asarray(points * np.diag(scaling)[:2] + scaling[:2, 2])


def _scale_track(track: Track, scaling: FloatArray) -> Track:
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


def _scale_true_targets(item: TrueTargets, scaling: FloatArray) -> TrueTargets:
    across, down = float(scaling[0, 0]), float(scaling[1, 1])
    cos, sin = np.cos(item.angles), np.sin(item.angles)
    return TrueTargets(
        ids=item.ids,
        centres=_scale_points(item.centres, scaling),
        lengths=item.lengths * np.hypot(across * cos, down * sin),
        widths=item.widths * np.hypot(across * sin, down * cos),
        angles=np.arctan2(down * sin, across * cos),
        velocities=item.velocities * (across, down),
    )
