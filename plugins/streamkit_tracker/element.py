"""particletrack: tracks of everything that moves."""

from __future__ import annotations

import enum

import numpy as np

from streamkit import (
    FeatureSpace,
    Frame,
    Property,
    PropertyError,
    Provenance,
    SettingsOf,
    Track,
    Tracks,
    TrackState,
    Transform,
    luma,
)
from streamkit_kernels import COMPILING, telling
from streamkit_tracker.frame_link import FrameLink
from streamkit_tracker.report.reports import TargetReport
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import TargetState
from streamkit_tracker.tracker import MultiTargetTracker
from streamkit_tracker.warm_up import warm_up
from streamkit_tracker.window_geometry import FloatArray

STATES = {state: TrackState(state) for state in TargetState}


class Compare(enum.StrEnum):
    """Space in which windows are compared with a target."""

    TEMPLATE = "template"
    FEATURES = "features"


class ParticleTrack(Transform):
    """Attaches tracks of what moves: detections start them, layered particle filters follow them.

    Reads the frame's registration, detections and features where there are any. A detection seen `birth-hits`
    times that has moved over the ground becomes a confirmed track. Without detections a track goes on by its
    appearance, then coasts with a growing covariance, at most as long as it was detected and no longer than
    `coast`; a detection continues it under its old id, even after it was not reported any more. `window`
    starts one target by hand, also while playing; it needs no detections, coasts while it is not seen, and is
    searched in a circle that grows until `coast` has passed. Targets end, each reported once as lost, on a
    cut, a new plane without a mapping, a new frame size, or a new epoch without registration.

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
    given_up: int = Property(
        0, read=lambda element: element._given_up(), doc="Targets that had to make room for others."
    )
    compare: Compare = Property(
        Compare.TEMPLATE,
        doc="template: the target's own eigen template; features: the feature space that comes with frames.",
    )

    def start(self) -> None:
        """Begins without targets."""
        with telling(lambda: self.post_warning(COMPILING)):
            warm_up()
        self._start_window = None if self.window is None else parse_window(self.window, self.name)
        self._tracker = MultiTargetTracker(self.settings)
        self._link = FrameLink(self.compare is Compare.FEATURES)
        self._warned = False

    def property_changed(self, name: str) -> None:
        """A window set while playing starts one more target in the next frame; a bad one leaves the old."""
        if name != "window":
            return
        try:
            window = None if self.window is None else parse_window(self.window, self.name)
        except PropertyError:
            self.__dict__["window"] = self.__dict__.get("_accepted_window")
            raise
        self._accepted_window = self.window
        if window is not None and self.is_playing:
            self._start_window = window

    def transform(self, frame: Frame) -> Frame:
        """Attaches Tracks."""
        image = luma(frame)
        observation = self._link.observe(frame)
        if self.compare is Compare.FEATURES and not self._warned and frame.metadata.get(FeatureSpace) is None:
            self._warned = True
            self.post_warning(
                "compare=features: no feature space comes with the frames yet: put waveleteigen upstream"
            )
        reports = self._tracker.step(image, observation)
        window, self._start_window = self._start_window, None
        if window is not None:
            try:
                reports = (*reports, self._tracker.start_target(image, window, observation))
            except ValueError as error:
                self.post_warning(f"window={self.window}: {error}")
        return frame.attach(Tracks(tuple(track(report) for report in reports)))

    def _given_up(self) -> int:
        tracker: MultiTargetTracker | None = self.__dict__.get("_tracker")
        return 0 if tracker is None else tracker.given_up


def parse_window(text: str, element: str) -> FloatArray:
    """Window float64[5] of "x,y,w,h" or "x,y,w,h,angle"; x, y is the top-left pixel of the unrotated window.

    Raises:
        PropertyError: it is not four or five finite numbers with a positive size.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    sound = len(numbers) in (4, 5) and np.isfinite(numbers).all() and min(numbers[2:4]) > 0
    if not sound:
        raise PropertyError(
            f'{element}: property window must be "x,y,w,h" or "x,y,w,h,angle" with w and h above 0, '
            f'got "{text}"; for example window=100,80,48,32'
        )
    left, top, width, height = numbers[:4]
    angle = numbers[4] if len(numbers) == 5 else 0.0
    return np.array([left + (width - 1) / 2, top + (height - 1) / 2, width, height, angle])


def track(report: TargetReport) -> Track:
    """A report as metadata."""
    x, y, length, width, angle = report.window.tolist()
    across, down = report.velocity.tolist()
    return Track(
        id=report.id,
        state=STATES[report.state],
        x=x,
        y=y,
        length=length,
        width=width,
        angle=angle,
        velocity=(across, down),
        covariance=report.covariance,
        score=report.score,
        age_ns=round(report.age_s * 1e9),
        provenance=Provenance(**vars(report.provenance)),
    )
