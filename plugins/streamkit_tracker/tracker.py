"""Follows many targets: births, measurement, merges and deaths."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from streamkit_tracker import kinematics
from streamkit_tracker.appearance_search import Likelihood, search
from streamkit_tracker.budget import Budget
from streamkit_tracker.detected_shape import Motion, remember, restarts
from streamkit_tracker.expectations import search_jobs
from streamkit_tracker.feature_template import FeatureTemplate
from streamkit_tracker.frame_crops import ByteArray
from streamkit_tracker.observation import (
    Measurement,
    Observation,
    Placement,
    Sighting,
    TargetReport,
    TargetState,
)
from streamkit_tracker.pairing import Pairing, pair, remember_features
from streamkit_tracker.provenance import TargetProvenance
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.target import Target
from streamkit_tracker.window_geometry import (
    ANGLE,
    IDENTITY,
    LENGTH,
    WIDTH,
    FloatArray,
    inside_windows,
    invertible,
    map_points,
    map_windows,
    visible_fraction,
    window_sides,
)
from streamkit_tracker.window_sampling import WindowSampler

MERGE_FRAMES = 3
MERGE_SCALE = 0.9
FRAGMENT_AREA = 3.5
HIDDEN_SCALE = 2.0
BIRTH_SCALE = 1.3
TENTATIVE_SHARE = 4
SMALLEST_SIDE = 10.0  # px, of what accelerations are reckoned in


BoolArray = NDArray[np.bool_]


def _rows(arrays: list[FloatArray]) -> FloatArray:
    """Arrays of one shape along a new first axis; for small ones faster than np.stack."""
    return np.concatenate(arrays).reshape(len(arrays), *arrays[0].shape)


class MultiTargetTracker:
    """Tracks what moves in a stream of frames.

    Same frames, same observations, same settings: the same reports, bit for bit; every target draws from its
    own generator, seeded by (seed, id).

    Args:
        settings: see `TrackerSettings`.

    Attributes:
        given_up: targets that had to make room for others.
    """

    def __init__(self, settings: TrackerSettings | None = None) -> None:
        self.settings = settings or TrackerSettings()
        self._likelihood = Likelihood(self.settings.sigma, self.settings.std_position)
        self._sampler = WindowSampler()
        self._targets: list[Target] = []
        self._next_id = 1
        self._shape: tuple[int, int] | None = None
        self._close: dict[tuple[int, int], int] = {}
        self._budget = Budget(self.settings.budget_ms / 1e3)
        self._frames = 0
        self.given_up = 0

    def start_target(self, image: ByteArray, window: FloatArray, observation: Observation) -> TargetReport:
        """Starts one target from a window drawn by hand.

        Args:
            image: uint8[h, w], the frame it was drawn on.
            window: float64[5], x y length width angle.
            observation: what came with the frame.

        Raises:
            ValueError: the window is not finite, has no area or lies outside the frame.
        """
        window = np.asarray(window, np.float64)
        if not np.isfinite(window).all() or min(window[LENGTH], window[WIDTH]) <= 0:
            raise ValueError(f"a window needs finite numbers and a positive size, got {window.tolist()}")
        self._shape = (image.shape[0], image.shape[1])
        if visible_fraction(window[None], self._shape)[0] <= 0:
            raise ValueError(f"a window must overlap the {image.shape[1]}x{image.shape[0]} frame")
        self._sampler.look_at(image)
        target = self._new_target(window, manual=True)
        target.start(self._sampler, observation.space, self._followed())
        return self._report([target], observation)[0]

    def step(self, image: ByteArray, observation: Observation) -> tuple[TargetReport, ...]:
        """Takes in the next frame.

        Args:
            image: uint8[h, w].
            observation: what came with it.

        Returns:
            One report for every target, in order of their ids; a target that ends is reported once as lost.
        """
        resized = self._shape is not None and self._shape != image.shape
        self._shape = (image.shape[0], image.shape[1])
        if resized or observation.placement is Placement.NEW:
            for target in self._targets:
                target.lose("the frame's size changed" if resized else "a cut, or a plane without a mapping")
        else:
            self._predict(observation)
            if observation.placement is Placement.LOST:
                for target in self._targets:
                    target.pass_time(observation.step_s, detected=False)
                    target.coast()
            else:
                self._sampler.look_at(image)
                began = time.perf_counter()
                self._look(observation)
                self._budget.spent(time.perf_counter() - began)
        reports = self._report(self._targets, observation)
        self._targets = [target for target in self._targets if target.state is not TargetState.LOST]
        return reports

    def _predict(self, observation: Observation) -> None:
        """Carries every target to this frame's pixels and ahead by the time between the frames."""
        if not self._targets:
            return
        homography = invertible(observation.to_previous)
        means = _rows([target.mean for target in self._targets])
        covariances = _rows([target.covariance for target in self._targets])
        if homography is not None:
            means, covariances = kinematics.carry(means, covariances, homography)
            self._carry_memory(homography)
        sides = window_sides(_rows([target.window for target in self._targets]))
        accelerations = np.maximum(sides, SMALLEST_SIDE)
        accelerations *= [target.liveliness for target in self._targets]
        means, covariances = kinematics.predict(means, covariances, observation.step_s, accelerations)
        for target, mean, covariance in zip(self._targets, means, covariances, strict=True):
            target.mean, target.covariance = mean, covariance

    def _carry_memory(self, homography: FloatArray) -> None:
        """Carries windows, trails and particles to this frame's pixels, all targets at once."""
        windows = map_windows(homography, _rows([target.window for target in self._targets]))
        # a target that has been confirmed by its detections has no use for its trail any more
        trails = [target.trail for target in self._targets if target.manual or target.appearance is None]
        points = [trail.positions for trail in trails]
        clouds = [target.appearance.cloud for target in self._targets if target.appearance is not None]
        points += [cloud.positions for cloud in clouds]
        mapped, _ = map_points(homography, np.concatenate(points))
        ends = list(accumulate(map(len, points)))
        parts = [mapped[end - len(part) : end] for end, part in zip(ends, points, strict=True)]
        for target, window in zip(self._targets, windows, strict=True):
            if target.manual:
                target.drawn_angle += float(window[ANGLE] - target.window[ANGLE])
            target.window = window
        for trail, part in zip(trails, parts[: len(trails)], strict=True):
            trail.positions = part
        for cloud, part in zip(clouds, parts[len(trails) :], strict=True):
            cloud.positions = part

    def _look(self, observation: Observation) -> None:
        """Measures every target in the frame, then settles births, merges and deaths."""
        pairing = pair(self._targets, observation, self.settings.max_speed)
        for target in self._targets:
            sighting = pairing.sightings.get(target.id)
            target.pass_time(observation.step_s, detected=sighting is not None or target.id in pairing.shared)
            target.provenance.shared = target.id in pairing.shared
            if sighting is not None:
                target.provenance.detection = sighting.row
                target.provenance.gate = pairing.gates[target.id]
        detected = [target for target in self._targets if target.id in pairing.sightings]
        seen = [pairing.sightings[target.id] for target in detected]
        remember([target.shape for target in detected], seen, observation.step_s)
        remember_features(detected, seen, observation.features_version)
        self._correct(self._measure(observation, pairing))
        self._finish(observation, pairing)
        self._merge(observation)
        if self.settings.auto_start:
            self._give_birth(observation, pairing)

    def _measure(self, observation: Observation, pairing: Pairing) -> dict[int, Measurement]:
        """Positions by target id: of the search for targets that are followed, else of the detection."""
        sightings = pairing.sightings
        known = [target for target in self._targets if target.appearance is not None]
        resting = self._resting(known, sightings)
        seen = [t for t in known if t.id not in resting and (t.id in sightings or not t.dormant)]
        for target in known:
            target.overlook()
        for target in seen:
            template = target.appearance.template if target.appearance is not None else None
            if isinstance(template, FeatureTemplate) and observation.space is not None:
                template.follow(observation.space)
            if target.manual:
                target.propose(self._sampler, observation.step_s)
        jobs = search_jobs(seen, sightings, self.settings, observation.step_s, self._budget.share)
        measurements = {
            target.id: sightings[target.id].measurement
            for target in self._targets
            if target.id in sightings and (target.appearance is None or target.id in resting)
        }
        for target, found in zip(seen, search(self._sampler, jobs, self._likelihood), strict=True):
            measurement = target.take(found, sightings.get(target.id))
            if measurement is not None:
                measurements[target.id] = measurement
        return measurements

    def _resting(self, known: list[Target], sightings: Mapping[int, Sighting]) -> set[int]:
        """Ids of the targets that a detection of their own is enough for in this frame: see `Budget.turn`."""
        self._frames += 1
        if self._budget.turn == 1:
            return set()
        steady = [t.id for t in known if not t.manual and t.id in sightings and not sightings[t.id].crowded]
        return {number for number in steady if (number + self._frames) % self._budget.turn}

    def _correct(self, measurements: dict[int, Measurement]) -> None:
        measured = [target for target in self._targets if target.id in measurements]
        if not measured:
            return
        found = [measurements[target.id] for target in measured]
        variances = np.array([measurement.variance for measurement in found])
        means, covariances = kinematics.correct(
            _rows([target.mean for target in measured]),
            _rows([target.covariance for target in measured]),
            np.array([measurement.position for measurement in found]),
            _rows([measurement.covariance for measurement in found]) + variances[:, None, None] * IDENTITY,
        )
        for target, mean, covariance in zip(measured, means, covariances, strict=True):
            target.mean, target.covariance = mean, covariance

    def _finish(self, observation: Observation, pairing: Pairing) -> None:
        if not self._targets:
            return
        windows = _rows([target.window for target in self._targets])
        visible = visible_fraction(windows, self._sampler.shape)
        upon = inside_windows(windows[:, :2], windows, HIDDEN_SCALE)
        there = [target.followed and not target.dormant for target in self._targets]
        others = ~np.eye(len(windows), dtype=np.bool_) & there
        hidden = np.any(upon & others, axis=1).tolist()
        # one that coasts makes room for one that is seen
        coasting = sum(target.gives_way for target in self._targets)
        followed = self._followed()
        wrong = self._restarts(pairing.sightings)
        for index, target in enumerate(self._targets):
            before = target.followed
            target.finish(
                self._sampler,
                observation.space,
                pairing.sightings.get(target.id),
                float(visible[index]),
                followed - coasting,
                hidden=hidden[index],
                restart=wrong.get(target.id),
            )
            followed += target.followed - before
        self._give_up(followed - self.settings.max_targets)

    def _restarts(self, sightings: Mapping[int, Sighting]) -> dict[int, tuple[FloatArray, bool]]:
        """Windows that are wrong by what was detected, by target id; see `Target.finish`."""
        known = [t for t in self._targets if t.appearance is not None and not t.manual and t.id in sightings]
        alone = [target for target in known if not sightings[target.id].crowded]
        if not alone:
            return {}
        motion = Motion(
            _rows([target.mean for target in alone]), _rows([target.covariance for target in alone])
        )
        windows = _rows([target.window for target in alone])
        alike = np.array([target.alike for target in alone])
        looked_at = np.array([target.provenance.similarity is not None for target in alone])
        windows[~alike, :2] = motion.means[~alike, :2]
        shapes, seen = [target.shape for target in alone], [sightings[target.id] for target in alone]
        found = zip(alone, restarts(shapes, seen, windows, motion, alike, looked_at), strict=True)
        return {target.id: restart for target, restart in found if restart is not None}

    def _give_up(self, surplus: int) -> None:
        """Ends the least certain targets, those that coast first, so that `max_targets` are left."""
        if surplus <= 0:
            return
        movable = [target for target in self._targets if target.followed and not target.manual]
        for target in sorted(movable, key=lambda t: (t.gives_way, t.doubt), reverse=True)[:surplus]:
            target.lose("made room: max-targets were followed")
            self.given_up += 1

    def _followed(self) -> int:
        return sum(target.followed for target in self._targets)

    def _give_birth(self, observation: Observation, pairing: Pairing) -> None:
        """Starts a tentative target on every detection that is nobody's and covers no followed target."""
        if not pairing.free:
            return
        followed = [target for target in self._targets if target.followed and not target.dormant]
        taken = _rows([target.window for target in followed]) if followed else np.zeros((0, 5))
        covered = np.any(inside_windows(observation.centroids, taken, BIRTH_SCALE), axis=1).tolist()
        room = self.settings.max_targets * (1 + TENTATIVE_SHARE) - len(self._targets)
        for index in pairing.free[: max(room, 0)]:
            x, y = observation.centroids[index]
            width, height = observation.boxes[index, 2:] - observation.boxes[index, :2]
            if covered[index]:
                continue
            born = self._new_target(np.array([x, y, width, height, 0.0]), manual=False)
            born.provenance = TargetProvenance(detection=index, cause="began on a detection")

    def _new_target(self, window: FloatArray, *, manual: bool) -> Target:
        target = Target(self._next_id, window, self.settings, manual=manual)
        self._next_id += 1
        self._targets.append(target)
        return target

    def _merge(self, observation: Observation) -> None:
        """Ends the younger of two targets that were on one object, with one velocity, for some frames."""
        followed = [target for target in self._targets if target.followed and not target.dormant]
        if len(followed) < 2:
            self._close = {}
            return
        windows = _rows([target.window for target in followed])
        within = inside_windows(windows[:, :2], windows, MERGE_SCALE)
        upon = within | within.T | self._fragments(followed, observation.boxes)
        if np.count_nonzero(upon) == len(followed):
            # each lies upon itself and nothing else
            self._close = {}
            return
        velocities = _rows([target.mean[2:] for target in followed])
        apart = np.linalg.norm(velocities[:, None] - velocities[None], axis=2)
        doubt = np.array([target.side + kinematics.speed_std(target.covariance) for target in followed])
        alike = apart < np.maximum(doubt[:, None], doubt[None])
        near = np.argwhere(np.triu(upon & alike, k=1))
        close: dict[tuple[int, int], int] = {}
        for older, younger in near:
            both = (followed[older].id, followed[younger].id)
            close[both] = self._close.get(both, 0) + 1
            if close[both] >= MERGE_FRAMES:
                followed[younger].lose(f"was on the same object as {followed[older].id}")
        self._close = close

    @staticmethod
    def _fragments(followed: list[Target], boxes: FloatArray) -> BoolArray:
        """Pairs in one detection of which the younger was hardly ever detected alone: bool[n, n]."""
        young = np.array([not target.shape.settled and not target.manual for target in followed])
        if not young.any():
            return np.zeros((len(followed), len(followed)), np.bool_)
        boxes = boxes[np.isfinite(boxes).all(axis=1)]
        areas = np.array([math.prod(target.shape.box) for target in followed])
        centres = _rows([target.window[:2] for target in followed])[:, None]
        inside = (boxes[None, :, :2] <= centres) & (centres <= boxes[None, :, 2:])
        holds = np.asarray(np.all(inside, axis=2), np.bool_)
        sizes = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
        # a detection several times larger than the older target may well show two
        single = np.asarray(holds & (sizes[None] < FRAGMENT_AREA * areas[:, None]), np.bool_)
        together = np.any(single[:, None] & holds[None], axis=2)
        return np.asarray(together & young[None])

    @staticmethod
    def _report(targets: list[Target], observation: Observation) -> tuple[TargetReport, ...]:
        targets = [target for target in targets if target.told]
        if not targets:
            return ()
        means = _rows([target.mean for target in targets])
        _, jacobians = map_points(observation.to_reference, means[:, :2])
        velocities = np.einsum("nij,nj->ni", jacobians, means[:, 2:])
        velocities = np.where(np.isfinite(velocities), velocities, math.nan)
        sides = window_sides(_rows([target.window for target in targets])).tolist()
        variances = np.array(
            [target.anchor_variance(side) for target, side in zip(targets, sides, strict=True)]
        )
        covariances = variances[:, None, None] * IDENTITY
        by_motion = [not target.looked_at for target in targets]
        covariances[by_motion] += _rows([target.covariance for target in targets])[by_motion, :2, :2]
        rows = zip(targets, velocities, covariances, strict=True)
        return tuple(target.report(velocity, covariance) for target, velocity, covariance in rows)
