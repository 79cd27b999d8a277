"""Measures every target in the frame: by its appearance where that is known, else by its detection."""

from __future__ import annotations

import math

import numpy as np

from streamkit_tracker.appearance.feature_template import FeatureTemplate
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import Appearance, IndexArray, TargetTable, followed
from streamkit_tracker.update.evidence import LEAST_SHARPNESS
from streamkit_tracker.update.expectations import SEARCH, SearchRows
from streamkit_tracker.update.layered_filter import LayerSettings, Particles
from streamkit_tracker.update.response import expect_response, find_response
from streamkit_tracker.update.search import Found, search
from streamkit_tracker.update.turned_box import motion_headings, turned_windows
from streamkit_tracker.window_geometry import ANGLE, IDENTITY, LENGTH, WIDTH, FloatArray

SIDES_STD = 0.12
LEAST_SHARE = 0.02  # of a patch that the correlation filter learns
UNSEEN_SPEED = 0.8  # factor per frame: an unseen target drawn by hand soon forgets its speed

Kind = tuple[type, tuple[int, int], LayerSettings, float, int]


def measure(
    table: TargetTable,
    searched: IndexArray,
    detected: FloatArray,
    observation: Observation,
    sampler: WindowSampler,
    settings: TrackerSettings,
    budget_share: float,
) -> None:
    """Fills in the measurements of all targets that are recognised or detected.

    Args:
        table: predicted, with its detections.
        searched: rows whose appearance is searched.
        detected: float64[d, 6], centroids x, y and boxes x0 y0 x1 y1, px.
        observation: of this frame.
        sampler: holds the frame.
        settings: of the tracker.
        budget_share: part of the usual particles.
    """
    rows = table.rows
    searches = _expectations(table, searched, detected, observation, sampler)
    usual = [settings.layers_for(found, len(searched), budget_share) for found in (False, True)]
    groups: dict[Kind, list[int]] = {}
    height, width = sampler.shape
    for place, (index, window) in enumerate(zip(searched.tolist(), searches["window"].tolist(), strict=True)):
        appearance = table.models[index].appearance
        assert appearance is not None
        patch, shorter = appearance.patch, appearance.context * min(window[LENGTH], window[WIDTH])
        factor = max(1, min(int(shorter // max(patch)), height, width))
        layers = usual[rows["detection"].item(index) >= 0]
        groups.setdefault((type(appearance.template), patch, layers, appearance.context, factor), []).append(
            place
        )
    for (_, _, layers, _, factor), members in groups.items():
        models = [table.models[index] for index in searched[members].tolist()]
        _take(table, searched[members], search(sampler, models, searches[members], layers, factor, settings))
    alone = np.flatnonzero((rows["detection"] >= 0) & ~rows["measured"])
    rows["measurement"][alone] = detected[rows["detection"][alone], :2]
    variances = np.array([std**2 for std in rows["detection_std"][alone].tolist()])
    rows["noise"][alone] = variances[:, None, None] * IDENTITY
    rows["measured"][alone] = True


def _take(table: TargetTable, index: IndexArray, found: Found) -> None:
    """Judges the results of a search for the rows `index`; recognised targets are measured and learn."""
    rows, verdicts = table.rows, []
    manual, unseen = rows["manual"][index].tolist(), (rows["frames_unseen"][index] > 0).tolist()
    has_detection = (rows["detection"][index] >= 0).tolist()
    for place, row in enumerate(index.tolist()):
        model, similarity = table.models[row], found.similarities.item(place)
        appearance = model.appearance
        assert appearance is not None
        verdict = model.evidence.judge(
            -math.log(max(similarity, 1e-9)),
            None
            if appearance.response is None
            else (appearance.response.peak, appearance.response.sharpness),
            informative=found.informative[place],
            unseen=manual[place] and unseen[place],
        )
        learns = verdict.seen and verdict.learnt and (manual[place] or has_detection[place])
        if verdict.seen:
            appearance.particles = found.particles[place]
        if learns:
            appearance.template.update(found.patches[place].copy())
        verdicts.append((verdict.seen, learns, verdict.share))
    rows["score"][index] = rows["similarity"][index] = found.similarities
    seen, rows["learnt"][index], rows["filter_share"][index] = zip(*verdicts, strict=True)
    recognised = np.array(seen)
    rows["recognised"][index] = recognised
    windows, index = found.windows[recognised], index[recognised]
    rows["window"][index], rows["measurement"][index] = windows, windows[:, :2]
    sides = np.sqrt(windows[:, LENGTH] * windows[:, WIDTH]).tolist()
    variances = np.array([(0.2 + 0.015 * side) ** 2 for side in sides])
    rows["noise"][index] = found.covariances[recognised] + variances[:, None, None] * IDENTITY
    rows["measured"][index] = True


def _expectations(
    table: TargetTable,
    searched: IndexArray,
    detected: FloatArray,
    observation: Observation,
    sampler: WindowSampler,
) -> SearchRows:
    """Rows of `SEARCH`; the correlation filter is asked before any particle is moved."""
    rows, searches = table.rows[searched], np.zeros(len(searched), SEARCH)
    found, covariance = rows["detection"] >= 0, rows["covariance"]
    searches["window"], searches["displacement"] = rows["window"], rows["mean"][:, 2:] * observation.step_s
    searches["seed"][found] = detected[rows["detection"][found], :2]
    searches["seed_std"] = np.where(found, rows["detection_std"], math.inf)
    searches["spread"] = np.sqrt((covariance[:, 0, 0] + covariance[:, 1, 1]) / 2)
    headings, deviations = motion_headings(rows["mean"], covariance, rows["window"])
    headings = np.where(np.isnan(headings), rows["window"][:, ANGLE], headings)
    expected = turned_windows(rows["mean"][:, :2], rows["box"], headings)
    searches["sides"], searches["heading"] = expected[:, LENGTH : WIDTH + 1], expected[:, ANGLE]
    searches["sides_precision"], searches["heading_precision"] = SIDES_STD**-2, deviations**-2
    searches["tolerance"] = [table.models[index].evidence.tolerance for index in searched.tolist()]
    for row, index in enumerate(searched.tolist()):
        appearance = table.models[index].appearance
        if appearance is None:
            continue
        if isinstance(appearance.template, FeatureTemplate) and observation.space is not None:
            appearance.template.follow(observation.space)
        if rows["manual"][row]:
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
        # The filter's search area covers any motion in a frame; only an unseen target needs its velocity.
        predicted = target["window"].copy()
        if target["frames_unseen"] > 0:
            predicted[:2] += target["mean"][2:] * observation.step_s
        unmoved = predicted.copy()
        unmoved[:2] = target["last_place"]
        appearance.response = find_response(
            appearance.discriminator,
            evidence,
            sampler,
            predicted,
            unmoved,
            int(target["frames_unseen"]),
        )
    response = appearance.response
    if response is None:
        search["sides_precision"] = search["heading_precision"] = 0.0
        return
    expect_response(search, response, evidence.tolerance, float(target["drawn_angle"]))
    if target["frames_unseen"] > 0:
        search["window"][2:] = *response.sides, response.angle


def learn_appearances(table: TargetTable, sampler: WindowSampler) -> None:
    """Gathers the particles of targets that were not recognised; filters learn targets that were."""
    rows = table.rows
    known = followed(rows)
    for index in np.flatnonzero(known & ~rows["recognised"]).tolist():
        model = table.models[index]
        assert model.appearance is not None
        model.appearance.particles = Particles.at(rows["mean"][index])
        if rows["manual"][index]:
            rows["mean"][index, 2:] *= UNSEEN_SPEED ** (1 - model.trail.steadiness)
    for index in np.flatnonzero(known & rows["manual"]).tolist():
        model, recognised = table.models[index], bool(rows["recognised"][index])
        if recognised:
            model.trail.add((float(rows["mean"][index, 0]), float(rows["mean"][index, 1])))
        appearance, share = model.appearance, float(rows["filter_share"][index])
        if appearance is None or appearance.discriminator is None or appearance.memory is None:
            continue
        discriminator, region = appearance.discriminator, None
        if recognised:
            region = discriminator.read(sampler, rows["window"][index])
            if share > LEAST_SHARE:
                discriminator.learn(sampler, region, share)
        appearance.memory.compare(discriminator, region, LEAST_SHARPNESS)
        rows["sure"][index] = appearance.memory.is_sure
