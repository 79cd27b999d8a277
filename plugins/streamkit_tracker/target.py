"""One target's life: what it remembers from frame to frame, and when it is confirmed or ends."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from streamkit_tracker import kinematics
from streamkit_tracker.appearance_search import Found, Prior, SearchJob, Template, read_window
from streamkit_tracker.box_shape import window_shape
from streamkit_tracker.correlation_filter import CorrelationFilter, Response
from streamkit_tracker.discrimination import ask, response_prior
from streamkit_tracker.eigen_template import EigenTemplate
from streamkit_tracker.evidence import Evidence
from streamkit_tracker.feature_template import FeatureTemplate, Space
from streamkit_tracker.layered_filter import Cloud
from streamkit_tracker.observation import Measurement, Sighting, TargetReport, TargetState
from streamkit_tracker.provenance import TargetProvenance
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.trail import Trail
from streamkit_tracker.window_geometry import FloatArray, half_turn
from streamkit_tracker.window_sampling import WindowSampler

ACCELERATION_SIDES = 2.0  # px/s^2 for each px of a target's side
SMALLEST_SIDE = 10.0
SPEED_SHARE = 1 / 3
YOUNG_S = 1.0  # first detections often show a part only: until then size and place follow fast
BOX_RATE, YOUNG_BOX_RATE = 0.15, 0.5
RESIZED = 0.18  # log ratio of a side beyond which the window starts again
FEATURE_RATE = 0.2
OFFSET_RATE, YOUNG_OFFSET_RATE = 0.12, 0.4
SIDES_STD = 0.12
CREDIT_AT_START_S = 0.2
CREDIT_RATE = 0.5
TENTATIVE_MISSES = 2
STRAIGHT = 0.5
MISFITS_BEFORE_RESTART = 3
REACH_PER_FRAME = 0.3
LONGEST_REACH = 3.0
UNSEEN_SPEED = 0.8  # a hand-drawn target has no road to keep to: what it did before is soon forgotten
LEAST_VISIBLE = 0.3


@dataclass(eq=False)
class Appearance:
    """What a followed target looks like and where its particles are."""

    template: Template
    cloud: Cloud
    patch: tuple[int, int]
    context: float
    discriminator: CorrelationFilter | None = None


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
        self.window = np.array(window, np.float64)
        self.box = (float(window[2]), float(window[3]))
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
        self._frames_unseen = 0
        self._misfits = 0
        self._offset = (0.0, 0.0)
        self._settings = settings
        self._evidence = Evidence(settings.lost_threshold, settings.update_threshold)
        self._response: Response | None = None
        self._generator = np.random.default_rng((settings.seed, number))

    @property
    def side(self) -> float:
        """Geometric mean of the window's sides, px."""
        return math.sqrt(float(self.window[2]) * float(self.window[3]))

    @property
    def followed(self) -> bool:
        """Whether the target has left the tentative state and goes on."""
        return self.state in (TargetState.CONFIRMED, TargetState.COASTING)

    @property
    def gives_way(self) -> bool:
        """Whether another target may take this one's place: it coasts and was not drawn by hand."""
        return self.state is TargetState.COASTING and not self.manual

    @property
    def doubt(self) -> float:
        """Standard deviation of the position relative to the target's side."""
        return math.sqrt(float(self.covariance[0, 0] + self.covariance[1, 1]) / 2) / self.side

    @property
    def acceleration_std(self) -> float:
        """Standard deviation of the acceleration, px/s^2: what is larger in the picture is nearer."""
        return ACCELERATION_SIDES * max(self.side, SMALLEST_SIDE)

    @property
    def speed_std(self) -> float:
        """Standard deviation of either part of the velocity, px/s."""
        return math.sqrt(float(self.covariance[2, 2] + self.covariance[3, 3]) / 2)

    def pass_time(self, step_s: float, *, detected: bool) -> None:
        """Counts one frame, with or without a detection."""
        self.provenance = TargetProvenance((float(self.mean[0]), float(self.mean[1])))
        self.age_s += step_s
        self._seen.append(detected)
        self.frames_undetected = 0 if detected else self.frames_undetected + 1
        gain = CREDIT_RATE if detected else -1.0
        self._credit_s = min(self._credit_s + gain * step_s, self._settings.coast_s)

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

    def remember(self, sighting: Sighting) -> None:
        """Lets the box and the feature vector follow a detection."""
        usual = YOUNG_BOX_RATE if self.age_s < YOUNG_S else BOX_RATE
        rate = 0.0 if sighting.crowded else usual
        width, height = self.box
        self.box = (width * (sighting.box[0] / width) ** rate, height * (sighting.box[1] / height) ** rate)
        if sighting.feature is None:
            return
        vector = np.asarray(sighting.feature, np.float64)
        if self.feature is not None and sighting.feature_version == self.feature_version:
            vector = (1 - FEATURE_RATE) * self.feature + FEATURE_RATE * vector
        self.feature, self.feature_version = vector, sighting.feature_version

    def propose(self, sampler: WindowSampler, step_s: float) -> None:
        """Asks the discriminator of a hand-drawn target where it went, before any particle is moved."""
        self._response = None
        if self.appearance is None or self.appearance.discriminator is None:
            return
        predicted = self.window.copy()
        predicted[:2] += self.mean[2:] * step_s
        self._response = ask(
            self.appearance.discriminator, self._evidence, sampler, predicted, self._frames_unseen
        )

    def job(self, step_s: float, sighting: Sighting | None, followed: int, share: float) -> SearchJob:
        """What to look for in this frame, once `mean` and `covariance` are predicted for it."""
        assert self.appearance is not None
        spread = math.sqrt(float(self.covariance[0, 0] + self.covariance[1, 1]) / 2)
        return SearchJob(
            self.window,
            self.appearance.cloud,
            self._generator,
            self.appearance.template,
            self.appearance.patch,
            self.appearance.context,
            (float(self.mean[2]) * step_s, float(self.mean[3]) * step_s),
            spread,
            min(1 + REACH_PER_FRAME * self._frames_unseen, LONGEST_REACH),
            self._prior(sighting),
            self._settings.layers_for(sighting is not None, followed, share),
            self._evidence.tolerance,
        )

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
        self._alike = verdict.seen
        if not self._alike:
            return None if sighting is None else sighting.measurement
        self.window = found.window
        self.appearance.cloud = found.cloud
        self._learnt = verdict.learnt and (self.manual or sighting is not None)
        self.provenance.learnt = self._learnt
        if self._learnt:
            self.appearance.template.update(found.patch)
        noise = (0.2 + 0.015 * self.side) ** 2
        return Measurement(
            (float(found.window[0]), float(found.window[1])), found.covariance + noise * np.eye(2)
        )

    def finish(
        self,
        sampler: WindowSampler,
        space: Space | None,
        sighting: Sighting | None,
        visible: float,
        followed: int,
        *,
        hidden: bool,
    ) -> None:
        """Ends the frame, after `mean` was corrected: keeps the window right and decides on the state.

        Args:
            sampler: has been shown the frame.
            space: feature space to compare in, or None.
            sighting: this target's detection, or None.
            visible: part of the window inside the frame.
            followed: number of targets followed.
            hidden: whether another target lies upon this one.
        """
        if self.appearance is None:
            self._finish_tentative(sampler, space, sighting, followed)
            return
        if not self._alike:
            self.window[:2] = self.mean[:2]
            self.appearance.cloud = Cloud.at(self.mean)
            if self.manual:
                self.mean[2:] *= UNSEEN_SPEED
        if sighting is not None and not self.manual:
            self._keep_right(sampler, space, sighting)
        if self._alike or self.frames_undetected == 0:
            self._frames_unseen = 0
        elif not hidden:
            self._frames_unseen += 1
        if self.manual and self._alike:
            self._credit_s = self._settings.coast_s
        if self.manual and self._learnt and self.appearance.discriminator is not None:
            self.appearance.discriminator.learn(sampler, self.window)
        unseen = not self.manual and self._frames_unseen >= self._settings.lost_frames
        if unseen or visible < LEAST_VISIBLE or self._credit_s <= 0:
            gone = "left the frame" if visible < LEAST_VISIBLE else "coasted too long"
            self.lose("not seen for lost-frames" if unseen else gone)
            return
        believed = self.manual or self.frames_undetected < self._settings.lost_frames
        seen = self.frames_undetected == 0 or (self._alike and believed)
        self.state = TargetState.CONFIRMED if seen else TargetState.COASTING

    def start(self, sampler: WindowSampler, space: Space | None, followed: int) -> None:
        """Confirms the target: from now on its appearance is known."""
        self.state = TargetState.CONFIRMED
        self.provenance.cause = self.provenance.cause or "confirmed"
        if not self.manual:
            self.window = self._window_from_detections(float(self.mean[0]), float(self.mean[1]))
        context = 1.0 if self.manual else self._settings.context
        side = self._settings.patch_for(context * float(max(self.window[2:4])), followed)
        self._learn_anew(sampler, space, (side, side) if space is None else space.patch_size, context)

    def report(self, velocity: FloatArray) -> TargetReport:
        """What is told about the target in this frame; `velocity`, float64[2], is px/s on the plane."""
        score = self._similarity if self.appearance is not None else sum(self._seen) / len(self._seen)
        return TargetReport(
            self.id,
            self.state,
            self.window.copy(),
            velocity,
            self.covariance[:2, :2].copy(),
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
        self.window = np.array([self.mean[0], self.mean[1], self.box[0], self.box[1], 0.0])
        hits = sum(self._seen)
        if self.frames_undetected > TENTATIVE_MISSES:
            self.lose("not detected again before it was confirmed")
        elif (
            sighting is not None
            and hits >= self._settings.birth_hits
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
        pixels = read_window(sampler, self.window, patch, context)
        template: Template = (
            EigenTemplate(pixels, self._settings.eigen) if space is None else FeatureTemplate(pixels, space)
        )
        discriminator = CorrelationFilter(sampler, self.window) if self.manual else None
        self.appearance = Appearance(template, Cloud.at(self.window), patch, context, discriminator)
        self._similarity, self._alike = 1.0, True

    def _trust(self, sighting: Sighting) -> float:
        return min(1.0, centroid_std(self.side) / sighting.std)

    def _prior(self, sighting: Sighting | None) -> Prior:
        centroid = (0.0, 0.0) if sighting is None else sighting.centroid
        std = math.inf if sighting is None else sighting.std
        if self.manual:
            if self._response is None:
                return Prior(centroid, std)
            return response_prior(self._response, self._evidence.tolerance, self.drawn_angle)
        heading, heading_std = self._heading()
        sides = window_shape(*self.box, float(self.window[4]) if heading is None else heading)
        return Prior(centroid, std, sides, SIDES_STD, heading or 0.0, heading_std)

    def _heading(self) -> tuple[float | None, float]:
        """Direction of motion in the frame and its standard deviation, or None while it is not known."""
        across, down = float(self.mean[2]), float(self.mean[3])
        speed = math.hypot(across, down)
        speed_std = self.speed_std
        if speed < 3 * speed_std or speed < 0.3 * self.side:
            return None, math.inf
        return math.atan2(down, across), max(0.08, 1.5 * speed_std / speed)

    def _window_from_detections(self, x: float, y: float) -> FloatArray:
        """float64[5]: the box's shape turned into the direction of motion."""
        heading, _ = self._heading()
        if heading is None:
            heading = float(self.window[4]) if self.followed and self.appearance else self.trail.heading
        length, width = window_shape(*self.box, heading)
        return np.array([x, y, length, width, half_turn(heading)])

    def _keep_right(self, sampler: WindowSampler, space: Space | None, sighting: Sighting) -> None:
        """Starts the template again where detections have shown for some time that the window is wrong."""
        assert self.appearance is not None
        trust = self._trust(sighting) ** 2
        x, y = float(self.window[0]), float(self.window[1])
        rate = trust * (YOUNG_OFFSET_RATE if self.age_s < YOUNG_S else OFFSET_RATE)
        across = self._offset[0] + rate * (sighting.centroid[0] - x - self._offset[0])
        down = self._offset[1] + rate * (sighting.centroid[1] - y - self._offset[1])
        self._offset = (across, down)
        self._misfits = 0 if self._alike else self._misfits + (trust > 0.3)
        lost_sight = self._misfits >= MISFITS_BEFORE_RESTART
        expected = self._window_from_detections(x + across, y + down)
        if lost_sight:
            expected[:2] = self.mean[:2]
        elif not self._wrong(expected):
            return
        self._misfits, self._offset = 0, (0.0, 0.0)
        self.window = expected
        known = isinstance(self.appearance.template, FeatureTemplate)
        self._learn_anew(
            sampler,
            space if known else None,
            self.appearance.patch,
            self.appearance.context,
        )

    def _wrong(self, expected: FloatArray) -> bool:
        """Whether the window differs from what detections and motion say by more than their noise."""
        heading, heading_std = self._heading()
        turned = abs(float(half_turn(expected[4] - self.window[4])))
        resized = max(abs(math.log(float(expected[i] / self.window[i]))) for i in (2, 3))
        return (
            math.hypot(*self._offset) > max(0.8, 0.06 * self.side)
            or (heading is not None and turned > max(0.25, 2.5 * heading_std))
            or resized > RESIZED
        )


def centroid_std(side: float) -> float:
    """Standard deviation expected of a detection's centroid, px, for a target of a given side, px."""
    return 1.0 + 0.04 * side
