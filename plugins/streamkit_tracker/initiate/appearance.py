"""Gives targets a template: when they are confirmed, and again where detections contradict their window."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter
from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.feature_template import FeatureTemplate, Space
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import CONFIRMED, LOST, TENTATIVE, Appearance, TargetTable, followed
from streamkit_tracker.update.layered_filter import Particles
from streamkit_tracker.update.memory import Memory
from streamkit_tracker.update.turned_box import motion_headings, turned_windows

STRAIGHT = 0.5


def start_appearances(
    table: TargetTable,
    observation: Observation,
    sampler: WindowSampler,
    settings: TrackerSettings,
) -> None:
    """Restarts templates and confirms tentative targets that have moved, in order of the ids.

    Args:
        table: updated, with the targets that end in this frame already lost.
        observation: of this frame.
        sampler: holds the frame.
        settings: of the tracker.
    """
    rows = table.rows
    hits_needed = min(settings.birth_hits, settings.birth_window)
    restarted = rows["restart"] & (rows["state"] != LOST)
    candidates = (rows["state"] == TENTATIVE) & (rows["detection"] >= 0)
    chosen = np.flatnonzero(restarted | candidates).tolist()
    if not chosen:
        return
    # what coasts may be ended in favour of a new target
    kept = int(np.count_nonzero((rows["state"] == CONFIRMED) | (followed(rows) & rows["manual"])))
    for index in chosen:
        model = table.models[index]
        if restarted[index]:
            assert model.appearance is not None
            in_space = isinstance(model.appearance.template, FeatureTemplate)
            patch = model.appearance.patch if in_space else None
            start_appearance(
                table, index, observation.space if in_space else None, sampler, settings, kept, patch
            )
            continue
        trail = model.trail
        x, y = observation.centroids[rows["detection"][index]].tolist()
        trail.add((x, y))
        if np.nansum(rows["hits"][index]) < hits_needed or kept >= settings.max_targets:
            continue
        moves = trail.travelled >= settings.min_travel and trail.straightness >= STRAIGHT
        if moves or observation.are_objects:
            if not observation.are_objects:
                _turn_window(table, index)
            start_appearance(table, index, observation.space, sampler, settings, kept)
            table.confirm(index)
            table.causes[int(rows["id"][index])] = "confirmed"
            kept += 1


def start_appearance(
    table: TargetTable,
    index: int,
    space: Space | None,
    sampler: WindowSampler,
    settings: TrackerSettings,
    count: int,
    patch: tuple[int, int] | None = None,
) -> None:
    """Learns the appearance of a target at its window.

    Args:
        table: of the targets.
        index: the target's row.
        space: feature space to compare in, or None for a template of the target's own.
        sampler: holds the frame.
        settings: of the tracker.
        count: number of targets followed.
        patch: samples of a patch, or None for the size that suits the window or the space.
    """
    target, manual = table.rows[index], bool(table.rows["manual"][index])
    window, context = target["window"].copy(), 1.0 if manual else settings.context
    if patch is None:
        side = settings.patch_for(context * max(window[2:4].tolist()), count)
        patch = (side, side) if space is None else space.patch_size
    pixels = sampler.read(window, patch, context)
    template = EigenTemplate(pixels, settings.eigen) if space is None else FeatureTemplate(pixels, space)
    appearance = Appearance(template, Particles.at(window), patch, context)
    if manual:
        appearance.discriminator = CorrelationFilter(sampler, window)
        appearance.memory = Memory(appearance.discriminator)
    table.models[index].appearance = appearance
    target["score"], target["recognised"] = 1.0, True


def _turn_window(table: TargetTable, index: int) -> None:
    """Turns the box of a tentative target into its direction of motion."""
    target = table.rows[index : index + 1]
    headings, _ = motion_headings(target["mean"], target["covariance"], target["window"])
    headings = np.where(np.isnan(headings), table.models[index].trail.heading, headings)
    target["window"] = turned_windows(target["window"][:, :2], target["box"], headings)
