"""Measures every target in the frame: by its appearance where that is known, else by its detection."""

from __future__ import annotations

import math

import numpy as np

from streamkit_tracker.appearance.feature_template import FeatureTemplate
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.observation import Observation
from streamkit_tracker.predict.constant_velocity import correct
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import Appearance, BoolArray, IndexArray, TargetTable, dormant, followed
from streamkit_tracker.update.detected_box import (
    SEARCH,
    SearchRows,
    expect,
    find_hidden,
    follow_detections,
    settle_windows,
)
from streamkit_tracker.update.layered_filter import Particles
from streamkit_tracker.update.priors import Prior
from streamkit_tracker.update.response import ask, response_prior
from streamkit_tracker.update.search import search
from streamkit_tracker.window_geometry import IDENTITY

SIDES_STD = 0.12
LEAST_SHARE = 0.02  # of a patch that the correlation filter learns
UNSEEN_SPEED = 0.8  # factor per frame: an unseen target drawn by hand soon forgets its speed


def update(
    table: TargetTable,
    observation: Observation,
    sampler: WindowSampler,
    settings: TrackerSettings,
    budget_share: float,
    resting: BoolArray,
) -> None:
    """Measures all targets, corrects their states and decides which windows restart.

    Args:
        table: predicted, with its detections.
        observation: of this frame.
        sampler: holds the frame.
        settings: of the tracker.
        budget_share: part of the usual particles.
        resting: bool[n], targets that are measured by their detection alone.
    """
    rows, detected = table.rows, observation.detected
    follow_detections(rows, detected, observation.step_s)
    found = rows["detection"] >= 0
    awake = found | ~dormant(rows, settings.lost_frames)
    searched = np.flatnonzero(followed(rows) & ~resting & awake)
    if len(searched):
        _measure_by_appearance(table, searched, observation, sampler, settings, budget_share)
    alone = np.flatnonzero(found & ~rows["measured"])
    if len(alone):
        rows["measurement"][alone] = detected[rows["detection"][alone], :2]
        _set_noise(table, alone, [std**2 for std in rows["detection_std"][alone].tolist()])
        rows["measured"][alone] = True
    correct(rows)
    find_hidden(rows, settings.lost_frames, *sampler.shape)
    settle_windows(rows, detected)
    _settle_appearances(table, sampler)


def _measure_by_appearance(
    table: TargetTable,
    searched: IndexArray,
    observation: Observation,
    sampler: WindowSampler,
    settings: TrackerSettings,
    budget_share: float,
) -> None:
    """Searches the rows `searched`; recognised targets are measured where they are found."""
    rows, models = table.rows, [table.models[index] for index in searched.tolist()]
    appearances = [model.appearance for model in models if model.appearance is not None]
    searches = _expectations(table, searched, appearances, observation, sampler)
    has_detection = (rows["detection"][searched] >= 0).tolist()
    usual = {found: settings.layers_for(found, len(searched), budget_share) for found in (False, True)}
    layers = [usual[found] for found in has_detection]
    found = search(sampler, appearances, [model.generator for model in models], layers, searches, settings)
    manual, unseen = rows["manual"][searched].tolist(), rows["frames_unseen"][searched].tolist()
    recognised, learnt, shares = [], [], []
    for index, appearance in enumerate(appearances):
        similarity, response = found.similarities.item(index), appearance.response
        verdict = models[index].evidence.judge(
            -math.log(max(similarity, 1e-9)),
            None if response is None else (response.peak, response.sharpness),
            informative=found.informative[index],
            unseen=manual[index] and unseen[index] > 0,
        )
        learns = verdict.seen and verdict.learnt and (manual[index] or has_detection[index])
        if verdict.seen:
            appearance.particles = found.particles[index]
        if learns:
            appearance.template.update(found.patches[index])
        recognised.append(verdict.seen)
        learnt.append(learns)
        shares.append(verdict.share)
    rows["score"][searched] = rows["similarity"][searched] = found.similarities
    rows["recognised"][searched], rows["learnt"][searched] = recognised, learnt
    rows["filter_share"][searched] = shares
    seen = searched[recognised]
    rows["window"][seen], rows["measurement"][seen] = found.windows[recognised], found.windows[recognised, :2]
    rows["measured"][seen] = True
    sides = np.sqrt(found.windows[recognised, 2] * found.windows[recognised, 3]).tolist()
    _set_noise(table, seen, [(0.2 + 0.015 * side) ** 2 for side in sides])
    rows["noise"][seen] += found.covariances[recognised]


def _set_noise(table: TargetTable, index: IndexArray, variances: list[float]) -> None:
    table.rows["noise"][index] = np.array(variances)[:, None, None] * IDENTITY


def _expectations(
    table: TargetTable,
    searched: IndexArray,
    appearances: list[Appearance],
    observation: Observation,
    sampler: WindowSampler,
) -> SearchRows:
    """Rows of `SEARCH`; the correlation filter is asked before any particle is moved."""
    rows, searches = table.rows, np.zeros(len(searched), SEARCH)
    expect(rows, searched, observation.detected, observation.step_s, searches)
    searches["position_precision"] = searches["seed_std"] ** -2
    searches["sides_precision"] = SIDES_STD**-2
    searches["heading_precision"] = searches["heading_std"] ** -2
    searches["tolerance"] = [table.models[index].evidence.tolerance for index in searched.tolist()]
    for row, (index, appearance) in enumerate(zip(searched.tolist(), appearances, strict=True)):
        if isinstance(appearance.template, FeatureTemplate) and observation.space is not None:
            appearance.template.follow(observation.space)
        if rows["manual"][index]:
            _expect_manual(table, index, appearance, observation, sampler, searches[row])
    return searches


def _expect_manual(
    table: TargetTable,
    index: int,
    appearance: Appearance,
    observation: Observation,
    sampler: WindowSampler,
    search: SearchRows,
) -> None:
    """Asks the correlation filter of a target drawn by hand where it is, and expects it there."""
    target, evidence = table.rows[index], table.models[index].evidence
    appearance.response = None
    if appearance.discriminator is not None:
        predicted = target["window"].copy()
        predicted[:2] += target["mean"][2:] * observation.step_s
        appearance.response = ask(
            appearance.discriminator,
            evidence,
            sampler,
            target["window"],
            predicted,
            int(target["frames_unseen"]),
        )
    response = appearance.response
    if response is not None:
        prior = response_prior(response, evidence.tolerance, float(target["drawn_angle"]))
        if target["frames_unseen"] > 0:
            search["window"][2:] = *response.sides, response.angle
    elif target["detection"] >= 0:
        x, y = observation.centroids[target["detection"]].tolist()
        prior = Prior((x, y), float(target["detection_std"]))
    else:
        prior = Prior()
    prior.write(search)


def _settle_appearances(table: TargetTable, sampler: WindowSampler) -> None:
    """Moves windows of targets that were not recognised to their state; filters learn those that were."""
    rows = table.rows
    known = followed(rows)
    missed = np.flatnonzero(known & ~rows["recognised"])
    rows["window"][missed, :2] = rows["mean"][missed, :2]
    for index in missed.tolist():
        model = table.models[index]
        assert model.appearance is not None
        model.appearance.particles = Particles.at(rows["mean"][index])
        if rows["manual"][index]:
            rows["mean"][index, 2:] *= UNSEEN_SPEED ** (1 - model.trail.steadiness)
    for index in np.flatnonzero(known & rows["manual"]).tolist():
        model = table.models[index]
        if rows["recognised"][index]:
            model.trail.add((float(rows["mean"][index, 0]), float(rows["mean"][index, 1])))
        share, appearance = float(rows["filter_share"][index]), model.appearance
        if share > LEAST_SHARE and appearance is not None and appearance.discriminator is not None:
            appearance.discriminator.learn(sampler, rows["window"][index], share)
