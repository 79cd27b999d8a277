"""particletrack: tracks of everything that moves."""

from __future__ import annotations

import dataclasses
import enum
from typing import cast

import numpy as np

from streamkit import (
    Detections,
    Features,
    FeatureSpace,
    Frame,
    FrameFlags,
    Property,
    PropertyError,
    Registration,
    RegistrationStatus,
    SettingsOf,
    Tracks,
    Transform,
    luma,
)
from streamkit.geometry.boxes import parse_turned_box
from streamkit.geometry.homography import inverse, is_invertible
from streamkit_kernels import start_kernels
from streamkit_tracker.appearance.window_sampling import Chroma
from streamkit_tracker.observation import FrameContinuity, Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.tracker import MultiTargetTracker
from streamkit_tracker.warm_up import warm_up
from streamkit_tracker.window_geometry import FloatArray

USUAL_STEP_S = 1 / 25
MAX_STEP_S = 10.0
NO_REGISTRATION = Registration(np.eye(3), np.eye(3))
NO_DETECTIONS = Detections(np.zeros((0, 2)), np.zeros((0, 4)), np.zeros(0), np.zeros(0))


class Compare(enum.StrEnum):
    """Space in which windows are compared with a target."""

    TEMPLATE = "template"
    FEATURES = "features"


class ParticleTrack(Transform):
    """Attaches tracks of what moves: detections start them, layered particle filters follow them.

    Reads the frame's registration, detections and features where there are any. A detection seen `birth-hits`
    times that has moved over the ground becomes a confirmed track. Without detections a track is found by its
    appearance, then coasts with a growing covariance, no longer than `coast`, and where detections are
    regions of motion no longer than it was detected; a detection continues it under its old id, even when it
    is no longer reported. `window` starts one target by hand, also while playing. It needs no detections,
    coasts while it is not seen, and is searched for until `coast` has passed: in a growing circle, and by a
    detector trained on it in a large part of the frame. All targets end, each reported once as lost, on a
    cut, a new plane without a mapping, a new frame size, or a new epoch without registration; except on a new
    frame size, a target drawn by hand goes on if its filter finds it in place.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! fakesink
    """

    sink = src = "video/x-raw, format={ I420, NV12, GRAY8 }"
    window: str | None = Property(
        None,
        unit="px",
        live=True,
        doc="x,y,w,h[,angle in rad]: left, top, size of a target in the next frame; each new one adds one.",
    )
    settings = SettingsOf(TrackerSettings)
    evicted: int = Property(
        0, read=lambda element: element._evicted(), doc="Targets that were ended to keep within max-targets."
    )
    compare: Compare = Property(
        Compare.TEMPLATE,
        doc="template: the target's own eigen template; features: the feature space that comes with frames.",
    )

    _accepted_window: str | None = None  # to go back to where a new window is refused

    def start(self) -> None:
        """Begins without targets."""
        start_kernels("streamkit_tracker", warm_up, is_live=self.query_live(), report=self.post_warning)
        self._start_window = self._parsed_window()
        self._tracker = MultiTargetTracker(self.settings)
        self._last: Frame | None = None

    def wants_upstream(self) -> tuple[str, ...]:
        """Elements whose detections and registration it follows."""
        return ("stitch", "framediff")

    def property_changed(self, name: str) -> None:
        """A window set while playing starts one more target in the next frame; a bad one leaves the old."""
        if name != "window":
            return
        try:
            window = self._parsed_window()
        except PropertyError:
            vars(self)["window"] = self._accepted_window
            raise
        self._accepted_window = self.window
        if window is not None and self.is_playing:
            self._start_window = window

    def transform(self, frame: Frame) -> Frame:
        """Attaches Tracks."""
        image = luma(frame)
        observation = observe(frame, self._last)
        self._last = frame
        if self.compare is Compare.TEMPLATE:
            observation = dataclasses.replace(observation, space=None)
        elif observation.space is None:
            self.warn_once(
                "compare=features: no feature space comes with the frames yet: put waveleteigen upstream"
            )
        tracks = self._tracker.step(image, observation)
        window, self._start_window = self._start_window, None
        if window is not None:
            try:
                tracks = (*tracks, self._tracker.start_target(image, window, observation))
            except ValueError as error:
                self.post_warning(f"window={self.window}: {error}")
        self.results["tracks"] = self._tracker.targets.confirmed
        return frame.attach(Tracks(tracks))

    def _parsed_window(self) -> FloatArray | None:
        try:
            return None if self.window is None else parse_turned_box(self.window)
        except ValueError as error:
            raise PropertyError(f"{self.name}: property window {error}") from None

    def _evicted(self) -> int:
        tracker: MultiTargetTracker | None = self.__dict__.get("_tracker")
        return 0 if tracker is None else tracker.evicted


def observe(frame: Frame, last: Frame | None) -> Observation:
    """The tracker's input for a frame: time and motion since the last one tracked, and what was detected."""
    registration = frame.get(Registration) or NO_REGISTRATION
    given, features = frame.get(Detections), frame.get(Features)
    detections = NO_DETECTIONS if given is None else given  # without a row it is false, too
    space = cast("FeatureSpace | None", frame.metadata.get(FeatureSpace))
    centroids = np.asarray(detections.centroids, np.float64).reshape(-1, 2)
    scores = np.asarray(detections.scores, np.float64)
    paired = features is not None and space is not None and len(features.vectors) == len(centroids)
    step_s = USUAL_STEP_S  # where the frames have no stamps
    if last is not None and last.pts is not None and frame.pts is not None and last.epoch == frame.epoch:
        step_s = min((frame.pts - last.pts) / 1e9, MAX_STEP_S)
    return Observation(
        step_s=step_s if step_s > 0 else USUAL_STEP_S,
        continuity=FrameContinuity.KNOWN if last is None else _continuity(frame, last),
        to_previous=np.asarray(_to_previous(registration, frame, last), np.float64),
        to_reference=registration.to_reference,
        chroma=_chroma(frame),
        centroids=centroids,
        boxes=np.asarray(detections.boxes).reshape(-1, 4),
        scores=scores if len(scores) == len(centroids) else None,
        are_objects=detections.are_objects,
        detector_ran=given is not None,
        features=features.vectors if paired and features is not None else None,
        features_version=0 if space is None else space.version,
        space=space,
    )


def _continuity(frame: Frame, last: Frame) -> FrameContinuity:
    registration, before = frame.get(Registration), last.get(Registration)
    if registration is None:
        if frame.epoch != last.epoch:
            return FrameContinuity.NEW
    elif registration.status == RegistrationStatus.CUT or (
        before is not None
        and registration.reference != before.reference
        and registration.reference_change is None
    ):
        return FrameContinuity.NEW
    elif registration.status == RegistrationStatus.LOST:
        return FrameContinuity.LOST
    return FrameContinuity.LOST if frame.flags & FrameFlags.CORRUPT else FrameContinuity.KNOWN


def _to_previous(registration: Registration, frame: Frame, last: Frame | None) -> FloatArray:
    """This frame's pixels to those of the last frame tracked, over the plane where frames are missing."""
    before = None if last is None else last.get(Registration)
    if last is None or before is None or frame.seq == last.seq + 1:
        return registration.to_previous
    to_plane = np.asarray(before.to_reference, np.float64)
    if registration.reference_change is not None:
        to_plane = registration.reference_change @ to_plane
    if not is_invertible(to_plane):
        return registration.to_previous
    return inverse(to_plane) @ registration.to_reference


def _chroma(frame: Frame) -> Chroma | None:
    """Views of a frame's planes u and v, uint8[h / 2, w / 2]; None where it has none, or an odd size."""
    height, width = luma(frame).shape
    if frame.caps.get("format") not in ("I420", "NV12") or height % 2 or width % 2:
        return None
    planes = frame.data[height:]
    if frame.caps["format"] == "NV12":
        return planes[:, 0::2], planes[:, 1::2]
    both = planes.reshape(2, height // 2, width // 2)
    return both[0], both[1]
