"""Time and motion between a frame and the last one tracked, from its metadata."""

from __future__ import annotations

from typing import cast

import numpy as np

from streamkit import (
    Detections,
    Features,
    FeatureSpace,
    Frame,
    FrameFlags,
    Registration,
    RegistrationStatus,
    luma,
)
from streamkit_tracker.appearance.feature_template import Space
from streamkit_tracker.appearance.window_sampling import Chroma
from streamkit_tracker.observation import Continuity, Observation
from streamkit_tracker.window_geometry import FloatArray, invertible

USUAL_STEP_S = 1 / 25
LONGEST_STEP_S = 10.0
NO_REGISTRATION = Registration(np.eye(3), np.eye(3))
NO_DETECTIONS = Detections(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))


class FrameLink:
    """Links each frame to the one before it: time, motion and what was detected.

    Args:
        compare_in_space: whether templates live in the feature space that travels with the frames.
    """

    def __init__(self, compare_in_space: bool) -> None:
        self._compare_in_space = compare_in_space
        self._last: Frame | None = None

    def observe(self, frame: Frame) -> Observation:
        """The tracker's input for a frame; call it once for each, in order."""
        registration = frame.get(Registration) or NO_REGISTRATION
        detections, features = frame.get(Detections) or NO_DETECTIONS, frame.get(Features)
        space = cast("Space | None", frame.metadata.get(FeatureSpace))
        centroids = np.asarray(detections.centroids, np.float64).reshape(-1, 2)
        paired = features is not None and space is not None and len(features.vectors) == len(centroids)
        last, step_s = self._last, USUAL_STEP_S  # where the stamps do not tell
        if last is not None and last.pts is not None and frame.pts is not None and last.epoch == frame.epoch:
            step_s = min((frame.pts - last.pts) / 1e9, LONGEST_STEP_S)
        observation = Observation(
            step_s=step_s if step_s > 0 else USUAL_STEP_S,
            continuity=self._continuity(frame),
            to_previous=self._to_previous(frame, registration),
            to_reference=registration.to_reference,
            chroma=chroma(frame),
            centroids=centroids,
            boxes=np.asarray(detections.boxes).reshape(-1, 4),
            are_objects=bool(detections.labels),
            features=features.vectors if paired and features is not None else None,
            features_version=0 if space is None else space.version,
            space=space if self._compare_in_space else None,
        )
        self._last = frame
        return observation

    def _continuity(self, frame: Frame) -> Continuity:
        registration, last = frame.get(Registration), self._last
        if last is None:
            return Continuity.KNOWN
        if registration is None:
            known = frame.epoch == last.epoch and not frame.flags & FrameFlags.CORRUPT
            return Continuity.KNOWN if known else self._without_registration(frame, last)
        before = last.get(Registration)
        new_plane = before is not None and registration.reference != before.reference
        if registration.status == RegistrationStatus.CUT or (
            new_plane and registration.reference_change is None
        ):
            return Continuity.NEW
        if registration.status == RegistrationStatus.LOST or frame.flags & FrameFlags.CORRUPT:
            return Continuity.LOST
        return Continuity.KNOWN

    @staticmethod
    def _without_registration(frame: Frame, last: Frame) -> Continuity:
        return Continuity.NEW if frame.epoch != last.epoch else Continuity.LOST

    def _to_previous(self, frame: Frame, registration: Registration) -> FloatArray:
        """This frame's pixels to those of the last frame tracked, over the plane where frames are missing."""
        last = self._last
        before = None if last is None else last.get(Registration)
        if last is None or before is None or frame.seq == last.seq + 1:
            return np.asarray(registration.to_previous, np.float64)
        to_plane = np.asarray(before.to_reference, np.float64)
        if registration.reference_change is not None:
            to_plane = registration.reference_change @ to_plane
        from_plane = invertible(to_plane)
        if from_plane is None:
            return np.asarray(registration.to_previous, np.float64)
        return np.asarray(from_plane @ registration.to_reference, np.float64)


def chroma(frame: Frame) -> Chroma | None:
    """Views of a frame's planes u and v, uint8[h / 2, w / 2]; None where it has none, or an odd size."""
    if frame.caps.get("format") not in ("I420", "NV12"):
        return None
    height, width = luma(frame).shape
    if height % 2 or width % 2:
        return None
    planes = frame.data[height:]
    if frame.caps["format"] == "NV12":
        return planes[:, 0::2], planes[:, 1::2]
    both = planes.reshape(2, height // 2, width // 2)
    return both[0], both[1]
