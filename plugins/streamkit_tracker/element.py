"""particletrack: tracks of everything that moves."""

from __future__ import annotations

import enum

import numpy as np

from streamkit import (
    LUMA_CAPS,
    FeatureSpace,
    Frame,
    Property,
    PropertyError,
    Provenance,
    Track,
    Tracks,
    TrackState,
    Transform,
    luma,
)
from streamkit_kernels import COMPILING, telling
from streamkit_tracker.eigen_template import EigenSettings
from streamkit_tracker.frame_link import FrameLink
from streamkit_tracker.layered_filter import LayerSettings
from streamkit_tracker.observation import TargetReport
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.tracker import MultiTargetTracker
from streamkit_tracker.warm_up import warm_up
from streamkit_tracker.window_geometry import FloatArray


class Compare(enum.StrEnum):
    """In what windows are compared with a target."""

    TEMPLATE = "template"
    FEATURES = "features"


class ParticleTrack(Transform):
    """Attaches tracks of what moves: detections start them, layered particle filters follow them.

    Reads the frame's registration, detections and features where there are any. A detection seen `birth-hits`
    times that has moved over the ground becomes a confirmed track. Without detections a track goes on by its
    appearance, then coasts with a growing covariance, at most as long as it was detected and no longer than
    `coast`; found again meanwhile, it has its old id, even if it was not told any more. `window` starts one
    target by hand, also while playing; it goes on without detections, coasts when it is not seen, and is
    looked for in a circle that grows until `coast` has passed. Targets end, each reported once as lost, on a
    cut, a new plane without a mapping, a new frame size, or a new epoch without registration.

    Example:
        dronetestsrc num-buffers=40 ! stitch ! framediff ! particletrack ! fakesink
    """

    sink = src = LUMA_CAPS
    window: str | None = Property(
        None,
        unit="px",
        live=True,
        doc="x,y,w,h[,angle in rad]: left, top, size of a target in the next frame; each new one adds one.",
    )
    auto_start: bool = Property(True, doc="Whether detections start targets.")
    max_targets: int = Property(
        64, min=1, max=1000, doc="Confirmed targets at once; 4 times as many tentative."
    )
    given_up: int = Property(
        0, read=lambda element: element._given_up(), doc="Targets that had to make room for others."
    )
    budget_ms: float = Property(
        0.0,
        min=0.0,
        max=10_000.0,
        unit="ms",
        doc="Time for a frame before particles and looks become fewer; 0 is no limit, and repeatable.",
    )
    birth_hits: int = Property(3, min=1, max=100, doc="Detections that confirm a target.")
    birth_window: int = Property(5, min=1, max=100, unit="frames", doc="The frames they have to lie in.")
    min_travel: float = Property(
        4.0, min=0.0, unit="px", doc="Way over the ground before a target is confirmed."
    )
    max_speed: float = Property(500.0, min=1.0, unit="px/s", doc="Fastest target expected, in frame pixels.")
    coast: float = Property(3.0, min=0.0, unit="s", doc="Longest time without a detection.")
    lost_threshold: float = Property(0.6, min=0.0, max=1.0, doc="Similarity below which a target is unseen.")
    lost_frames: int = Property(
        3, min=1, max=1000, unit="frames", doc="Unseen frames from which only a detection finds it."
    )
    update_threshold: float = Property(
        0.85, min=0.0, max=1.0, doc="Similarity from which the template learns; low values learn the ground."
    )
    particles: int = Property(220, min=1, max=8000, doc="Positions in layer 1, for a target not detected.")
    keep: int = Property(12, min=1, max=200, doc="Positions that go on to layers 2 and 3.")
    size_particles: int = Property(6, min=0, max=50, doc="Sizes tried in layer 2 for each position kept.")
    angle_particles: int = Property(6, min=0, max=50, doc="Angles tried in layer 3 for each position kept.")
    std_position: float = Property(
        0.125, min=0.001, max=5.0, doc="Wide position noise, relative to the target's mean side."
    )
    std_size: float = Property(0.02, min=0.0, max=1.0, doc="Relative noise of length and width.")
    std_angle: float = Property(0.03, min=0.0, max=3.2, unit="rad", doc="Noise of the angle.")
    sigma: float = Property(
        0.09, min=0.001, max=10.0, doc="Standard deviation of the residual in the likelihood."
    )
    patch: int = Property(
        32, min=8, max=128, unit="samples", doc="Largest side of the compared patches; 16 in a crowd."
    )
    eigenvectors: int = Property(16, min=0, max=128, doc="Largest size of a template's eigen basis.")
    batch: int = Property(5, min=1, max=100, unit="frames", doc="Patches learnt at once.")
    forgetting: float = Property(0.95, min=0.01, max=1.0, doc="Weight of the past at each update.")
    compare: Compare = Property(
        Compare.TEMPLATE,
        doc="template: the target's own eigen template; features: the feature space that comes with frames.",
    )
    seed: int = Property(0, min=0, doc="Same seed and same frames give the same tracks.")

    def start(self) -> None:
        """Begins without targets."""
        with telling(lambda: self.post_warning(COMPILING)):
            warm_up()
        self._start_window = None if self.window is None else parse_window(self.window, self.name)
        self._tracker = MultiTargetTracker(self._settings())
        self._link = FrameLink(self.compare is Compare.FEATURES)
        self._spaceless = False

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
        if (
            self.compare is Compare.FEATURES
            and not self._spaceless
            and frame.metadata.get(FeatureSpace) is None
        ):
            self._spaceless = True
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

    def _settings(self) -> TrackerSettings:
        layers = LayerSettings(
            self.particles,
            self.keep,
            self.size_particles,
            self.angle_particles,
            self.std_size,
            self.std_angle,
        )
        return TrackerSettings(
            layers=layers,
            eigen=EigenSettings(self.eigenvectors, self.batch, self.forgetting),
            patch=self.patch,
            std_position=self.std_position,
            sigma=self.sigma,
            update_threshold=self.update_threshold,
            lost_threshold=self.lost_threshold,
            lost_frames=self.lost_frames,
            birth_hits=min(self.birth_hits, self.birth_window),
            birth_window=self.birth_window,
            min_travel=self.min_travel,
            coast_s=self.coast,
            max_speed=self.max_speed,
            max_targets=self.max_targets,
            budget_s=self.budget_ms / 1e3,
            auto_start=self.auto_start,
            seed=self.seed,
        )


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
        state=TrackState(report.state),
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
