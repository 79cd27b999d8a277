"""New targets: tentative ones on detections, their confirmation, and the templates of confirmed ones."""

from __future__ import annotations

import math

import numpy as np

from streamkit.geometry.track import FeatureSpace
from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.feature_template import FeatureTemplate
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import TENTATIVE, IndexArray, TargetTable
from streamkit_tracker.trail import JITTER, MAX_POSITIONS, extended, span, straightness
from streamkit_tracker.update.detected_box import LARGE_SIDE, RATED_S, turned_shapes
from streamkit_tracker.update.drawn_target import DrawnTarget
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, FloatArray

# The last detections of a target, by which its regions are judged; fewer say nothing of their size or path.
SIGHTINGS = 5
MAX_SIZE_STD = 0.4  # of the logarithm of the area: parts of a target are half of it, or twice a part
LIKELY = 0.5  # more than this is more likely than not
TENTATIVE_SHARE = 4  # tentative targets for each confirmed one: in clutter most detections begin none


def add_tentative(table: TargetTable, observation: Observation, free: IndexArray) -> None:
    """Starts a tentative target on every free detection; `free` are the rows that no target was given."""
    capacity = table.settings.max_targets * (1 + TENTATIVE_SHARE) - len(table.models)
    chosen = free[: max(capacity, 0)]
    if not len(chosen):
        return
    low, high = observation.boxes[chosen, :2], observation.boxes[chosen, 2:]
    is_whole = observation.are_objects | ((high - low).prod(axis=1) >= LARGE_SIDE**2)
    centres = np.where(is_whole[:, None], (low + high) / 2, observation.centroids[chosen])
    windows = np.column_stack([centres, high - low, np.zeros(len(chosen))])
    first = table.add(windows, drawn=False, cause="began on a detection")
    table.rows["detection"][first:], table.rows["whole"][first:] = chosen, is_whole


def start_appearances(table: TargetTable, observation: Observation, sampler: WindowSampler) -> None:
    """Confirms tentative targets, in order of the ids; of the others it notes the rule that they do not meet.

    Those of regions of motion have to move over the ground, to show an object, and to be likely to last:
    where leaves or tall structures are found for some frames at a time, so few detections are no evidence.
    """
    rows, settings = table.rows, table.settings
    candidates = np.flatnonzero((rows["state"] == TENTATIVE) & (rows["detection"] >= 0))
    if not len(candidates):
        return
    lasting_hits = in_same_time(settings.lasting_hits, observation.step_s)
    found = rows["detection"][candidates]
    positions, seen = observation.centroids[found], sightings(observation, found)
    for index, position, sighting in zip(candidates.tolist(), positions, seen, strict=True):
        model = table.models[index]
        model.trail = extended(model.trail, position)
        model.sightings = extended(model.sightings, sighting)
        obstacle = find_obstacle(table, index)
        if not obstacle and not observation.are_objects:
            likelihood = table.survival.probability(rows["detections"].item(index), lasting_hits)
            recent = model.trail[-in_same_time(MAX_POSITIONS, observation.step_s) :]
            obstacle = find_doubt(recent, model.sightings, settings, likelihood)
        if obstacle:
            table.causes[rows["id"].item(index)] = f"waits, {obstacle}"
            continue
        if not observation.are_objects:
            right, down = span(model.trail)
            one = rows[index : index + 1]
            one["window"][:, ANGLE] = np.arctan2(down, right)  # until the direction of the motion is known
            one["window"][:, LENGTH:] = turned_shapes(one)[0]
        start_appearance(table, index, observation.space, sampler)
        table.confirm(index, "confirmed")


def sightings(observation: Observation, detections: IndexArray) -> FloatArray:
    """Scores, 1 where there are none, and natural logarithms of the areas, px squared: float64[n, 2]."""
    boxes = observation.boxes[detections]
    areas = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    scores = np.ones(len(areas)) if observation.scores is None else observation.scores[detections]
    return np.column_stack([np.nan_to_num(scores, nan=1.0), np.log(areas)])


def find_obstacle(table: TargetTable, index: int) -> str:
    """Why the detected target in a row is not confirmed, whatever it is: rule, colon, numbers; or empty."""
    settings, hits = table.settings, np.count_nonzero(table.rows["hits"][index] == 1.0)
    needed = min(settings.birth_hits, settings.birth_window)
    if hits < needed:
        frames = f"{hits:g} of the last {settings.birth_window} frames"
        return f"detected too seldom: {frames}, needs {needed}"
    if table.settled >= settings.max_targets:
        return f"there is no room: max-targets={settings.max_targets}"
    return ""


def in_same_time(detections: int, step_s: float) -> int:
    """How many detections take as long as so many at 25 frames a second; `SIGHTINGS` at least, but no more.

    What clutter shows lasts for some time, not for some frames.
    """
    return min(detections, max(SIGHTINGS, round(detections * RATED_S / step_s)))


def find_doubt(trail: FloatArray, sightings: FloatArray, settings: TrackerSettings, likelihood: float) -> str:
    """Why regions of motion are no target yet: rule, colon, numbers; empty if they are.

    They have to move over the ground, and the last ones to be clear and of one size. Structures that shift
    against the ground, as relief does under a camera that moves, leave regions that are faint, or that break
    up and grow together. `likelihood` is that of reaching `lasting_hits`.
    """
    if (travel := math.hypot(*span(trail))) < settings.min_travel:
        return f"hardly moved: {travel:.1f} px, min-travel={settings.min_travel:g}"
    if (straight := straightness(trail)) < JITTER:
        return f"moves to and fro: straightness {straight:.2f}, needs {JITTER:g}"
    scores, areas = sightings[-SIGHTINGS:].T
    if (score := scores.mean()) < settings.birth_score:
        return f"faint: mean score {score:.2f}, birth-score={settings.birth_score:g}"
    if (size_std := areas.std()) > MAX_SIZE_STD:
        return f"its size changes: deviation {size_std:.2f} of the log area, at most {MAX_SIZE_STD:g}"
    if likelihood <= LIKELY:
        return f"may end soon: {likelihood:.0%} last for lasting-hits={settings.lasting_hits}"
    return ""


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
