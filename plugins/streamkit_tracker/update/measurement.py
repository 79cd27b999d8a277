"""Measures every target in the frame: by its appearance where that is known, else by its detection."""

from __future__ import annotations

import math

import numpy as np

from streamkit_tracker.appearance.feature_template import FeatureTemplate
from streamkit_tracker.appearance.window_sampling import WindowSampler, shrink_factor
from streamkit_tracker.observation import Observation
from streamkit_tracker.targets import IndexArray, TargetRows, TargetTable
from streamkit_tracker.trail import extended, steadiness
from streamkit_tracker.update.detected_box import measure_shared, turned_shapes
from streamkit_tracker.update.drawn_target import DrawnTarget
from streamkit_tracker.update.evidence import Evidence
from streamkit_tracker.update.layered_filter import SEARCH, Estimates, SearchRows
from streamkit_tracker.update.response import expect_response, find_response
from streamkit_tracker.update.search import SearchGroup, search
from streamkit_tracker.window_geometry import IDENTITY, LENGTH, WIDTH, Float32Array, FloatArray

SIDES_STD = 0.12
MIN_CONTRAST = 1e-3
MIN_SPREAD = 0.5  # px
DETECTION_SHARE = 0.5
UNSEEN_SPEED = 0.8  # factor per frame: an unseen target drawn by hand soon forgets its speed


def measure(
    table: TargetTable,
    searched: IndexArray,
    observation: Observation,
    sampler: WindowSampler,
    budget_share: float,
) -> None:
    """Fills in the measurements of all targets that are recognised or detected.

    A detection that shows its target whole measures the centre of its box: the centre of mass of a region
    wanders as legs and arms move. A smaller one measures its centre of mass, which one pixel at its edge
    hardly moves.

    `searched` are the rows whose appearance is searched, with `budget_share` of the usual particles.
    """
    rows, settings = table.rows, table.settings
    searches = _expectations(table, searched, observation, sampler)
    models = [table.models[index] for index in searched.tolist()]
    # fewer particles where a detection leads; none leads a target drawn by hand
    is_led = (rows["detection"][searched] >= 0) & ~rows["drawn"][searched]
    layers = [settings.seen_layers if led else settings.layers for led in is_led.tolist()]
    if budget_share < 1:
        layers = [each.reduced(budget_share) for each in layers]
    groups: dict[SearchGroup, list[int]] = {}
    for number, (model, window) in enumerate(zip(models, searches["window"], strict=True)):
        assert model.template is not None
        factor = shrink_factor(window, model.patch, sampler.shape)
        group = SearchGroup(type(model.template), model.patch, layers[number], factor)
        groups.setdefault(group, []).append(number)
    for group, members in groups.items():
        alike = [models[number] for number in members]
        found = search(sampler, alike, searches.take(members), group, settings.sigma**2)
        _judge(table, searched[members], *found)
    for region in set(rows["detection"][rows["shared"]].tolist()):
        sharing = np.flatnonzero(rows["shared"] & (rows["detection"] == region))
        measure_shared(rows, sharing, observation.boxes[region])
    alone = np.flatnonzero((rows["detection"] >= 0) & ~rows["measured"])
    chosen, is_whole = rows["detection"][alone], rows["whole"][alone, None]
    middles = (observation.boxes[chosen, :2] + observation.boxes[chosen, 2:]) / 2
    rows["measurement"][alone] = np.where(is_whole, middles, observation.centroids[chosen])
    rows["noise"][alone] = rows["detection_std"][alone, None, None] ** 2 * IDENTITY
    rows["measured"][alone] = True


def _judge(
    table: TargetTable, index: IndexArray, found: Estimates, distances: FloatArray, patches: Float32Array
) -> None:
    """Judges the results of a search for the rows `index`; recognised targets are measured and learn."""
    rows, verdicts = table.rows, []
    similarities, informative = np.exp(-distances), (found.contrasts > MIN_CONTRAST).tolist()
    drawn, is_crowded = rows["drawn"][index].tolist(), rows["crowded"][index].tolist()
    for number, row in enumerate(index.tolist()):
        model = table.models[row]
        assert model.template is not None
        verdict = model.evidence.judge(
            -math.log(max(similarities.item(number), 1e-9)),
            None if model.drawn is None else model.drawn.response,
            informative=model.template.textured and informative[number],
        )
        learns = verdict.learnt and (drawn[number] or is_crowded[number])
        if verdict.seen:
            model.particles = found.particles[number]
        if learns:
            model.template.update(patches[number].copy())
        verdicts.append((verdict.seen, learns, verdict.share))
    rows["score"][index] = rows["similarity"][index] = similarities
    seen, rows["learnt"][index], rows["filter_share"][index] = zip(*verdicts, strict=True)
    recognised = np.array(seen)
    rows["recognised"][index] = recognised
    windows, index = found.windows[recognised], index[recognised]
    rows["window"][index], rows["measurement"][index] = windows, windows[:, :2]
    deviations = 0.2 + 0.015 * np.sqrt(windows[:, LENGTH] * windows[:, WIDTH])
    rows["noise"][index] = found.covariances[recognised] + deviations[:, None, None] ** 2 * IDENTITY
    rows["measured"][index] = True


def _expectations(
    table: TargetTable, searched: IndexArray, observation: Observation, sampler: WindowSampler
) -> SearchRows:
    """Rows of `SEARCH`; the correlation filter is asked before any particle is moved."""
    rows, searches = table.rows.take(searched), np.zeros(len(searched), SEARCH)
    found, covariance = rows["detection"] >= 0, rows["covariance"]
    searches["window"], searches["displacement"] = rows["window"], rows["mean"][:, 2:] * observation.step_s
    searches["seed"][found] = observation.centroids[rows["detection"][found]]
    searches["seed_std"] = np.where(found, rows["detection_std"], np.inf)
    shapes, deviations = turned_shapes(rows)
    searches["sides"], searches["heading"] = shapes[:, :2], shapes[:, 2]
    searches["sides_precision"], searches["heading_precision"] = SIDES_STD**-2, deviations**-2
    models = [table.models[index] for index in searched.tolist()]
    searches["tolerance"] = [model.evidence.tolerance for model in models]
    for row, model in enumerate(models):
        if isinstance(model.template, FeatureTemplate) and observation.space is not None:
            model.template.follow(observation.space)
        if model.drawn is not None:
            _expect_drawn(rows[row], model.drawn, model.evidence, observation.step_s, sampler, searches[row])
    wide = table.settings.std_position * searches["window"][:, LENGTH : WIDTH + 1].mean(axis=1)
    searches["wide_spread"] = wide = np.maximum(wide, 1.0)
    spread = np.sqrt((covariance[:, 0, 0] + covariance[:, 1, 1]) / 2)
    searches["spread"] = np.minimum(np.maximum(spread, MIN_SPREAD), wide)
    searches["seed_spread"] = np.minimum(DETECTION_SHARE * searches["seed_std"], wide)
    return searches


def _expect_drawn(
    target: TargetRows,
    drawn: DrawnTarget,
    evidence: Evidence,
    step_s: float,
    sampler: WindowSampler,
    search: SearchRows,
) -> None:
    """Expects a target drawn by hand where its correlation filter finds it."""
    is_unseen = bool(target["frames_unseen"] > 0)
    # The filter's search area covers any motion in a frame; only an unseen target needs its velocity.
    predicted = target["window"].copy()
    if is_unseen:
        predicted[:2] += target["mean"][2:] * step_s
    unmoved = predicted.copy()
    unmoved[:2] = target["last_position"]
    response = find_response(drawn.filter, evidence, sampler, predicted, unmoved, is_unseen=is_unseen)
    drawn.response = response
    if response is None:
        search["sides_precision"] = search["heading_precision"] = 0.0
        return
    expect_response(search, response, evidence.tolerance, float(target["drawn_angle"]))
    if is_unseen:
        search["window"][LENGTH:] = response.window[LENGTH:]


def learn_detected(table: TargetTable, searched: IndexArray, sampler: WindowSampler) -> None:
    """Lets the templates of the rows `searched` learn the windows that detections of their own have set.

    What a template is not shown it cannot find in the next frame without a detection.
    """
    rows, is_led = table.rows, table.rows["led"]
    for row in np.flatnonzero(is_led | ~rows["recognised"]).tolist():
        table.models[row].particles = None  # they begin at the window again
    index = searched[is_led[searched]]
    windows = np.concatenate([rows["mean"][index, :2], rows["window"][index, LENGTH:]], axis=1)
    models = [table.models[row] for row in index.tolist()]
    shapes = [
        (each.patch, shrink_factor(at, each.patch, sampler.shape))
        for each, at in zip(models, windows, strict=True)
    ]
    for patch, factor in set(shapes):  # those that are alike at once
        alike = [number for number, shape in enumerate(shapes) if shape == (patch, factor)]
        crops = sampler.crop(windows[alike], factor, len(alike))
        for number, pixels in zip(alike, sampler.sample(windows[alike], patch, crops=crops), strict=True):
            template = models[number].template
            assert template is not None
            template.update(pixels)
    rows["learnt"][index] = True


def follow_drawn(table: TargetTable, sampler: WindowSampler) -> None:
    """Lets the filters of targets drawn by hand learn; moves targets to where their detectors find them."""
    rows = table.rows
    for index in np.flatnonzero(table.followed & rows["drawn"]).tolist():
        target, model = rows[index], table.models[index]
        drawn, is_seen = model.drawn, bool(target["recognised"])
        assert drawn is not None
        if is_seen:
            model.trail = extended(model.trail, target["mean"][:2])
        else:
            target["mean"][2:] *= UNSEEN_SPEED ** (1 - steadiness(model.trail))
        window = target["window"].copy()
        drawn.learn(sampler, window if is_seen else None, float(target["filter_share"]))
        found = drawn.redetect(sampler, window, is_seen=is_seen)
        target["sure"] = drawn.is_sure
        if drawn.is_sure:
            target["unsure_s"] = 0.0
        if found is not None:
            target["window"], target["mean"][:2], target["mean"][2:] = found, found[:2], 0.0
            target["recognised"] = True
            model.particles, model.trail = None, found[None, :2].copy()
