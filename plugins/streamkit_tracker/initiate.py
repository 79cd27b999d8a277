"""New targets: tentative ones on detections, their confirmation, and the templates of confirmed ones."""

from __future__ import annotations

import math

import numpy as np

from streamkit.geometry.track import FeatureSpace
from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.feature_template import FeatureTemplate
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.observation import Observation
from streamkit_tracker.targets import TENTATIVE, IndexArray, TargetTable
from streamkit_tracker.trail import extended, span, straightness
from streamkit_tracker.update.detected_box import LARGE_SIDE, motion_headings, turned_windows
from streamkit_tracker.update.drawn_target import DrawnTarget
from streamkit_tracker.window_geometry import LENGTH, WIDTH

MIN_STRAIGHTNESS = 0.5
TRAVEL_STDS = 2.0  # of the registration: a twentieth of what stands still would seem to move so far
LIKELY = 0.5  # more than this is more likely than not
TENTATIVE_SHARE = 4


def add_tentative(table: TargetTable, observation: Observation, free: IndexArray) -> None:
    """Starts a tentative target on every free detection; `free` are the rows that no target was given."""
    capacity = table.settings.max_targets * (1 + TENTATIVE_SHARE) - len(table.models)
    for index in free[: max(capacity, 0)].tolist():
        low, high = observation.boxes[index, :2], observation.boxes[index, 2:]
        is_whole = observation.are_objects or (high - low).prod() >= LARGE_SIDE**2
        centre = (low + high) / 2 if is_whole else observation.centroids[index]
        window = np.array([*centre, *(high - low), 0.0])
        born = table.add(window, drawn=False, cause="began on a detection")
        table.rows["detection"][born], table.rows["whole"][born] = index, is_whole


def start_appearances(table: TargetTable, observation: Observation, sampler: WindowSampler) -> None:
    """Confirms tentative targets, in order of the ids.

    Those of regions of motion have to move by more than the registration may be wrong, and to be likely to
    last: where leaves or tall structures are found for some frames at a time, so few detections are no
    evidence.
    """
    rows, settings = table.rows, table.settings
    hits_needed = min(settings.birth_hits, settings.birth_window)
    candidates = np.flatnonzero((rows["state"] == TENTATIVE) & (rows["detection"] >= 0)).tolist()
    if not candidates:
        return
    lasts = table.survival.probabilities() > LIKELY
    for index in candidates:
        model = table.models[index]
        position = observation.centroids[rows["detection"][index]]
        model.trail = extended(model.trail, position)
        if np.nansum(rows["hits"][index]) < hits_needed or table.settled >= settings.max_targets:
            continue
        if not observation.are_objects:
            right, down = span(model.trail)
            least = max(settings.min_travel, TRAVEL_STDS * observation.registration_std)
            travel = least if settings.min_travel > 0 else 0.0
            if math.hypot(right, down) < travel or straightness(model.trail) < MIN_STRAIGHTNESS:
                continue
            if not lasts[min(rows["detections"].item(index), settings.lasting_hits)]:
                table.causes[rows["id"].item(index)] = "waits: most that were detected as often ended soon"
                continue
            one = rows[index : index + 1]
            headings, deviations = motion_headings(one["mean"], one["covariance"], one["window"])
            headings = np.where(np.isinf(deviations), np.arctan2(down, right), headings)
            one["window"] = turned_windows(one["window"][:, :2], one["box"], headings)
        start_appearance(table, index, observation.space, sampler)
        table.confirm(index, "confirmed")


def start_appearance(
    table: TargetTable, index: int, space: FeatureSpace | None, sampler: WindowSampler
) -> None:
    """Learns the appearance of the target in a row at its window, in a feature space or its own template."""
    target, model, settings = table.rows[index], table.models[index], table.settings
    window = target["window"].copy()
    side = settings.patch_for(window[LENGTH : WIDTH + 1].max(), table.settled)
    model.patch = (side, side) if space is None else space.patch_size
    pixels = sampler.sample(window[None], model.patch)[0]
    model.template = (
        EigenTemplate(pixels, settings.eigen) if space is None else FeatureTemplate(pixels, space)
    )
    if target["drawn"]:
        model.drawn = DrawnTarget(sampler, window)
    target["score"], target["recognised"] = 1.0, True
