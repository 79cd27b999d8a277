"""Follows many targets: predict, associate, update, delete, initiate, report."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from streamkit.geometry.track import Track
from streamkit_tracker.appearance.box_colours import COLOURS_VERSION, box_colours
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.associate import associate
from streamkit_tracker.budget import Budget
from streamkit_tracker.delete import (
    coast_all,
    end_duplicates,
    end_gone,
    end_surplus,
    pass_time,
)
from streamkit_tracker.initiate import add_tentative, start_appearance, start_appearances
from streamkit_tracker.observation import FrameContinuity, Observation
from streamkit_tracker.predict import correct, predict
from streamkit_tracker.report import report
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import COASTING, IndexArray, TargetTable
from streamkit_tracker.update.detected_box import follow_boxes, follow_detections
from streamkit_tracker.update.measurement import follow_drawn, learn_detected, measure
from streamkit_tracker.window_geometry import LENGTH, WIDTH, ByteArray, FloatArray, visible_fraction

# Frames between two searches of a target that its detections keep in place, after which it learns; the second
# while there is not enough time. Detections are enough: rendered cars are followed as exactly with both.
SEARCH_EVERY, SPARING_EVERY = 2, 4


class MultiTargetTracker:
    """Tracks what moves in a stream of frames.

    Same frames, same observations, same settings: the same reports, bit for bit; every target draws from its
    own generator, seeded by (seed, id).

    Args:
        settings: see `TrackerSettings`.

    Attributes:
        targets: the table of targets.
        evicted: targets that were ended to keep within `max_targets`.
    """

    def __init__(self, settings: TrackerSettings | None = None) -> None:
        self.settings = settings or TrackerSettings()
        self.targets = TargetTable(self.settings)
        self.evicted = 0
        self._sampler = WindowSampler()
        self._shape: tuple[int, int] | None = None
        self._budget = Budget(self.settings.budget_ms / 1e3)
        self._frames = 0

    def start_target(self, image: ByteArray, window: FloatArray, observation: Observation) -> Track:
        """Starts one target from a window drawn by hand.

        Args:
            image: uint8[h, w], the frame it was drawn on.
            window: float64[5], x y length width angle.
            observation: what came with the frame.

        Raises:
            ValueError: the window is not finite, has no area or lies outside the frame.
        """
        window, targets = np.asarray(window, np.float64), self.targets
        if not np.isfinite(window).all() or min(window[LENGTH], window[WIDTH]) <= 0:
            raise ValueError(f"a window needs finite numbers and a positive size, got {window.tolist()}")
        self._shape = (image.shape[0], image.shape[1])
        if visible_fraction(window[None], self._shape)[0] <= 0:
            raise ValueError(f"a window must overlap the {image.shape[1]}x{image.shape[0]} frame")
        self._sampler.set_frame(image, observation.chroma)
        row = targets.add(window[None], drawn=True, cause="drawn by hand")
        start_appearance(targets, row, observation.space, self._sampler)
        targets.confirm(row, "drawn by hand")
        return report(targets, observation)[-1]

    def step(self, image: ByteArray, observation: Observation) -> tuple[Track, ...]:
        """Tracks all targets into the next frame.

        Args:
            image: uint8[h, w].
            observation: what came with it.

        Returns:
            One track for every target, in order of their ids; a target that ends is reported once as lost.
        """
        targets, sampler = self.targets, self._sampler
        targets.begin_frame()
        if observation.detector_ran:
            targets.are_objects = observation.are_objects
        if observation.are_objects and observation.features is None:
            colours = box_colours(image, observation.chroma, observation.boxes)
            observation = replace(observation, features=colours, features_version=COLOURS_VERSION)
        sampler.set_frame(image, observation.chroma)
        if not self._carry(image, observation):
            return report(targets, observation)
        began = time.perf_counter()
        self._frames += 1
        rows, step_s = targets.rows, observation.step_s
        detected = np.concatenate([observation.centroids, observation.boxes], axis=1, dtype=np.float64)
        free = associate(targets, detected, observation)
        pass_time(targets, step_s, observation.detector_ran)
        follow_detections(rows, detected, step_s, targets.are_objects)
        searched = self._searched()
        measure(targets, searched, observation, sampler, self._budget.share)
        correct(rows)
        follow_boxes(rows, detected, targets.are_objects)
        learn_detected(targets, searched, sampler)
        follow_drawn(targets, sampler)
        end_gone(targets, sampler.shape)
        start_appearances(targets, observation, sampler)
        if len(rows) > self.settings.max_targets:
            self.evicted += end_surplus(targets)
        end_duplicates(targets)
        if self.settings.auto_start:
            add_tentative(targets, observation, free)
        if self.settings.budget_ms > 0:
            self._budget.spent(time.perf_counter() - began)
        return report(targets, observation)

    def _carry(self, image: ByteArray, observation: Observation) -> bool:
        """Predicts the targets, or ends them at a cut; returns whether they can be searched in this frame."""
        targets = self.targets
        is_resized = self._shape is not None and self._shape != image.shape
        self._shape = (image.shape[0], image.shape[1])
        if is_resized or observation.continuity is FrameContinuity.NEW:
            cause = "the frame's size changed" if is_resized else "a cut, or a plane without a mapping"
            targets.rows["state"] = COASTING
            targets.rows["frames_unseen"] += 1
            for row, model in enumerate(targets.models):
                # a registration that fails is taken for a cut; a filter can tell
                window = targets.rows["window"][row]
                if is_resized or not model.is_in_place(self._sampler, window):
                    targets.lose(row, cause)
            return False
        predict(targets, observation.to_previous, observation.step_s)
        if observation.continuity is FrameContinuity.LOST:
            pass_time(targets, observation.step_s, detector_ran=False)  # its detections are not used
            coast_all(targets)
            return False
        return True

    def _searched(self) -> IndexArray:
        """Rows of the targets whose appearance is searched in this frame."""
        rows, followed = self.targets.rows, self.targets.followed
        found = rows["detection"] >= 0
        # in the other frames a detection of its own is enough: the target is neither searched nor learnt
        every = SEARCH_EVERY if self._budget.share >= 1 else SPARING_EVERY
        is_resting = rows["led"] & ((rows["id"] + self._frames) % every > 0)
        # boxes that show the whole target are better than any template
        return np.flatnonzero(followed & ~is_resting & ~rows["whole"] & (found | ~self.targets.dormant))
