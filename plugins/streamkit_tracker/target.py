"""One target's life: what it remembers from frame to frame, and when it is confirmed or ends."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from streamkit_tracker import kinematics
from streamkit_tracker.appearance import Appearance
from streamkit_tracker.appearance_search import Found, SearchJob
from streamkit_tracker.correlation_filter import Response
from streamkit_tracker.detected_shape import DetectedShape, centroid_std
from streamkit_tracker.discrimination import ask, response_prior
from streamkit_tracker.evidence import Evidence
from streamkit_tracker.feature_template import FeatureTemplate, Space
from streamkit_tracker.layered_filter import Cloud, LayerSettings
from streamkit_tracker.observation import Measurement, Sighting, TargetReport, TargetState
from streamkit_tracker.provenance import TargetProvenance
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.trail import Trail
from streamkit_tracker.window_geometry import FloatArray
from streamkit_tracker.window_priors import Prior
from streamkit_tracker.window_sampling import WindowSampler

ACCELERATION_SIDES = 2.0  # px/s^2 for each px of a target's side
DETECTED_ACCELERATION_SIDES = 6.0  # the same where detections correct what the wider search catches
SPEED_SHARE = 1 / 3
CREDIT_AT_START_S = 0.2
CREDIT_RATE = 1.0
LOOK_STD = 0.1  # px, of a look at a target that keeps its look
CREEP = 0.35  # sides for each unit of usual distance: how far a template comes to sit beside a soft target
DOUBT_TOLD = 0.5  # sides; a coasting target whose place is less sure is kept, but not told
TENTATIVE_MISSES = 2
STRAIGHT = 0.5
REACH_PER_FRAME = 0.3
LONGEST_REACH = 3.0
UNSEEN_SPEED = 0.8  # a hand-drawn target has no road to keep to: what it did before is soon forgotten
LEAST_VISIBLE = 0.3
LEAST_SHARE = 0.02  # of a patch that is worth learning


class Target:
    """A target between its first detection and its loss.

    Positions are pixels of the latest frame; the tracker carries `mean`, `covariance`, `window`, the trail
    and the particles to the next frame, for all targets at once.

    Args:
        number: its id.
        window: float64[5], the first window.
        settings: of the tracker.
        manual: whether a user drew the window; then neither its shape nor its heading follow detections.
    """

    def __init__(
        self, number: int, window: FloatArray, settings: TrackerSettings, *, manual: bool = False
    ) -> None:
        self.id = number
        self.state = TargetState.TENTATIVE
        self.manual = manual
        self.window: FloatArray = np.array(window, np.float64)
        self.shape = DetectedShape((float(window[2]), float(window[3])))
        self.drawn_angle = float(window[4])
        self.mean = np.array([window[0], window[1], 0.0, 0.0])
        speed_std = settings.max_speed * SPEED_SHARE
        self.covariance = kinematics.initial_covariance(centroid_std(self.side), speed_std)
        self.trail = Trail((float(window[0]), float(window[1])))
        self.appearance: Appearance | None = None
        self.feature: FloatArray | None = None
        self.feature_version = 0
        self.age_s = 0.0
        self.frames_undetected = 0
        self.provenance = TargetProvenance(cause="drawn by hand" if manual else "")
        self._seen: deque[bool] = deque([True], maxlen=settings.birth_window)
        self._credit_s = CREDIT_AT_START_S
        self._similarity = 1.0
        self._alike = True
        self._learnt = False
        self._share = 0.0
        self._frames_unseen = 0
        self._settings = settings
        self._evidence = Evidence(settings.lost_threshold, settings.update_threshold)
        self._response: Response | None = None
        self._generator = np.random.default_rng((settings.seed, number))

    @property
    def side(self) -> float:
        """Geometric mean of the window's sides, px."""
        return math.sqrt(self.window.item(2) * self.window.item(3))

    @property
    def followed(self) -> bool:
        """Whether the target has left the tentative state and goes on."""
        return self.state in (TargetState.CONFIRMED, TargetState.COASTING)

    @property
    def dormant(self) -> bool:
        """Whether only a detection can wake it: neither one nor its look was found for some frames."""
        return not self.manual and self._frames_unseen >= self._settings.lost_frames

    @property
    def told(self) -> bool:
        """Whether the target is worth a row: a dormant one whose place is not known any more is not."""
        return self.state is not TargetState.COASTING or not self.dormant or self.doubt < DOUBT_TOLD

    @property
    def gives_way(self) -> bool:
        """Whether another target may take this one's place: it coasts and was not drawn by hand."""
        return self.state is TargetState.COASTING and not self.manual

    @property
    def doubt(self) -> float:
        """Standard deviation of the position relative to the target's side."""
        return kinematics.position_std(self.covariance) / self.side

    @property
    def liveliness(self) -> float:
        """Standard deviation of the acceleration, sides (10 px at least) per s^2: the larger the nearer."""
        return ACCELERATION_SIDES if self.manual else DETECTED_ACCELERATION_SIDES

    def anchor_variance(self, side: float) -> float:
        """Variance of where in the target its template sits, px^2: an error that no look at it corrects."""
        if self.appearance is None:
            return 0.0
        if self.manual:
            return (LOOK_STD + CREEP * self._evidence.usual_distance * side) ** 2
        return centroid_std(side) ** 2

    def pass_time(self, step_s: float, *, detected: bool) -> None:
        """Counts one frame, with or without a detection."""
        self.provenance = TargetProvenance((self.mean.item(0), self.mean.item(1)))
        self.age_s += step_s
        self._seen.append(detected)
        self.frames_undetected = 0 if detected else self.frames_undetected + 1
        gain = CREDIT_RATE if detected else -1.0
        self._credit_s = min(self._credit_s + gain * step_s, self._settings.coast)

    def coast(self) -> None:
        """Takes the prediction for this frame, which could not be looked at."""
        displacement = self.mean[:2] - self.window[:2]
        self.window[:2] += displacement
        if self.appearance is not None:
            self.appearance.cloud.positions = self.appearance.cloud.positions + displacement
        if self.followed:
            self.state = TargetState.COASTING
        spent = self._credit_s <= 0
        if spent or (not self.followed and self.frames_undetected > TENTATIVE_MISSES):
            self.lose("coasted too long without registration")

    def lose(self, cause: str) -> None:
        """Ends the target, and says why."""
        self.state = TargetState.LOST
        self.provenance.cause = cause

    def propose(self, sampler: WindowSampler, step_s: float) -> None:
        """Asks the discriminator of a hand-drawn target where it went, before any particle is moved."""
        self._response = None
        if self.appearance is None or self.appearance.discriminator is None:
            return
        predicted = self.window.copy()
        predicted[:2] += self.mean[2:] * step_s
        self._response = ask(
            self.appearance.discriminator,
            self._evidence,
            sampler,
            self.window,
            predicted,
            self._frames_unseen,
        )

    def job(self, motion: FloatArray, prior: FloatArray, layers: LayerSettings) -> SearchJob:
        """What to look for in this frame.

        Args:
            motion: float64[7], see `SearchJob`.
            prior: float64[8], see `prior_rows`.
            layers: how many particles.
        """
        assert self.appearance is not None
        window = self.window
        if self._response is not None and self._frames_unseen > 0:
            window = np.array([*window[:2], *self._response.sides, self._response.angle])
        return SearchJob(
            window,
            self.appearance.cloud,
            self._generator,
            self.appearance.template,
            self.appearance.patch,
            self.appearance.context,
            motion,
            prior,
            layers,
            self._evidence.tolerance,
        )

    @property
    def reach(self) -> float:
        """How much wider than usual to look, 1 or more, for a target not seen lately."""
        return min(1 + REACH_PER_FRAME * self._frames_unseen, LONGEST_REACH)

    def prior(self, sighting: Sighting | None) -> Prior:
        """What is expected of the window of a hand-drawn target before it is looked for."""
        if self._response is not None:
            return response_prior(self._response, self._evidence.tolerance, self.drawn_angle)
        return Prior() if sighting is None else Prior(sighting.centroid, sighting.std)

    def overlook(self) -> None:
        """Nobody looked for the target in this frame."""
        self._alike = self._learnt = False
        self._share = 0.0

    def take(self, found: Found, sighting: Sighting | None) -> Measurement | None:
        """Takes the result of the search; gives the measured position, if there is one to believe."""
        assert self.appearance is not None
        self._similarity = self.provenance.similarity = found.similarity
        verdict = self._evidence.judge(
            -math.log(max(found.similarity, 1e-9)),
            None if self._response is None else (self._response.peak, self._response.sharpness),
            informative=found.informative,
            unseen=self.manual and self._frames_unseen > 0,
        )
        self._alike, self._share = verdict.seen, verdict.share
        if not self._alike:
            return None if sighting is None else sighting.measurement
        self.window = found.window
        self.appearance.cloud = found.cloud
        self._learnt = verdict.learnt and (self.manual or sighting is not None)
        self.provenance.learnt = self._learnt
        if self._learnt:
            self.appearance.template.update(found.patch)
        noise = (0.2 + 0.015 * self.side) ** 2
        x, y, *_ = found.window.tolist()
        return Measurement((x, y), noise, found.covariance)

    def finish(
        self,
        sampler: WindowSampler,
        space: Space | None,
        sighting: Sighting | None,
        visible: float,
        followed: int,
        *,
        hidden: bool,
        restart: tuple[FloatArray, bool] | None = None,
    ) -> None:
        """Ends the frame, after `mean` was corrected: keeps the window right and decides on the state.

        Args:
            sampler: has been shown the frame.
            space: feature space to compare in, or None.
            sighting: this target's detection, or None.
            visible: part of the window inside the frame.
            followed: number of targets followed.
            hidden: whether another target lies upon this one.
            restart: window, float64[5], where detections say that the template is to begin again, and
                whether the state moves there; None where the window is right.
        """
        if self.appearance is None:
            self._finish_tentative(sampler, space, sighting, followed)
            return
        if not self._alike:
            self.window[:2] = self.mean[:2]
            self.appearance.cloud = Cloud.at(self.mean)
            if self.manual:
                self.mean[2:] *= UNSEEN_SPEED ** (1 - self.trail.steadiness)
        elif self.manual:
            self.trail.add((float(self.mean[0]), float(self.mean[1])))
        alone = sighting is not None and not sighting.crowded
        if restart is not None:
            window, moves = restart
            if moves:
                self.mean[:2] = window[:2]
            self._restart(sampler, space, window, followed)
        if self._alike or self.frames_undetected == 0:
            self._frames_unseen = 0
        elif not hidden:
            self._frames_unseen += 1
        if self.manual and self._alike:
            self._credit_s = self._settings.coast
        if self._share > LEAST_SHARE and self.appearance.discriminator is not None:
            self.appearance.discriminator.learn(sampler, self.window, self._share)
        if visible < LEAST_VISIBLE or self._credit_s <= 0:
            self.lose("left the frame" if visible < LEAST_VISIBLE else "coasted too long")
            return
        believed = self.manual or self.frames_undetected < self._settings.lost_frames
        seen = alone or (self._alike and believed)
        self.state = TargetState.CONFIRMED if seen else TargetState.COASTING

    def start(self, sampler: WindowSampler, space: Space | None, followed: int) -> None:
        """Confirms the target: from now on its appearance is known."""
        self.state = TargetState.CONFIRMED
        self.provenance.cause = self.provenance.cause or "confirmed"
        if not self.manual:
            self.window = self.shape.window(float(self.mean[0]), float(self.mean[1]), self._direction()[0])
        context = 1.0 if self.manual else self._settings.context
        side = self._settings.patch_for(context * float(max(self.window[2:4])), followed)
        self._learn_anew(sampler, space, (side, side) if space is None else space.patch_size, context)

    @property
    def alike(self) -> bool:
        """Whether the target was recognised in this frame."""
        return self._alike

    @property
    def looked_at(self) -> bool:
        """Whether the window is where the target was seen, as one drawn by hand, not where it should be."""
        return self.manual and self._alike and self.state is TargetState.CONFIRMED

    def report(self, velocity: FloatArray, covariance: FloatArray) -> TargetReport:
        """What is told about the target in this frame.

        Args:
            velocity: float64[2], px/s on the plane.
            covariance: float64[2, 2] of x and y, px squared.
        """
        score = self._similarity if self.appearance is not None else sum(self._seen) / len(self._seen)
        return TargetReport(
            self.id,
            self.state,
            self.window.copy(),
            velocity,
            covariance,
            min(max(score, 0.0), 1.0),
            self.age_s,
            self.provenance,
        )

    def _finish_tentative(
        self, sampler: WindowSampler, space: Space | None, sighting: Sighting | None, followed: int
    ) -> None:
        """Only detections speak; no pixel is read before the target is confirmed."""
        if sighting is not None:
            self.trail.add(sighting.centroid)
        self.window = np.array([*self.mean[:2], *self.shape.box, 0.0])
        hits = sum(self._seen)
        if self.frames_undetected > TENTATIVE_MISSES:
            self.lose("not detected again before it was confirmed")
        elif (
            sighting is not None
            and hits >= min(self._settings.birth_hits, self._settings.birth_window)
            and followed < self._settings.max_targets
        ):
            travels = (
                self.trail.travelled >= self._settings.min_travel and self.trail.straightness >= STRAIGHT
            )
            if travels:
                self.start(sampler, space, followed)

    def _learn_anew(
        self, sampler: WindowSampler, space: Space | None, patch: tuple[int, int], context: float
    ) -> None:
        self.appearance = Appearance.of(
            sampler, self.window, patch, context, space, self._settings.eigen, discriminated=self.manual
        )
        self._similarity, self._alike = 1.0, True

    def _direction(self) -> tuple[float, float]:
        """Direction of motion and its standard deviation, or the window's or the trail's meanwhile."""
        heading, heading_std = kinematics.heading(self.mean, self.covariance, self.side)
        if heading is None:
            known = self.followed and self.appearance is not None
            heading = self.window.item(4) if known else self.trail.heading
        return heading, heading_std

    def _restart(
        self, sampler: WindowSampler, space: Space | None, window: FloatArray, followed: int
    ) -> None:
        """Begins the template again at another window."""
        assert self.appearance is not None
        self.window = window
        context = self.appearance.context
        if isinstance(self.appearance.template, FeatureTemplate):
            self._learn_anew(sampler, space, self.appearance.patch, context)
        else:
            side = self._settings.patch_for(context * float(max(window[2:4])), followed)
            self._learn_anew(sampler, None, (side, side), context)
