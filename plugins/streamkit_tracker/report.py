"""The tracks that are reported of a frame."""

from __future__ import annotations

import math

import numpy as np

from streamkit.geometry.track import Provenance, Track, TrackState
from streamkit_tracker.delete import position_doubt
from streamkit_tracker.observation import Observation
from streamkit_tracker.targets import (
    COASTING,
    CONFIRMED,
    SETTLED_S,
    TargetTable,
    centroid_std,
)
from streamkit_tracker.window_geometry import IDENTITY, map_points

STATES = tuple(TrackState)  # in the order of the codes in the table
REPORTED = (
    "id", "state", "window", "score", "age_s", "predicted", "detection", "gate", "similarity", "shared",
    "learnt",
)  # fmt: skip
# sides; a target that coasts at a position less certain is kept without a report
MAX_DOUBT, OBJECT_DOUBT = 0.5, 0.1
DRAWN_STD = 0.1  # px, of a match with a target that keeps its appearance
CREEP = 0.35  # sides per unit of usual distance: drift of a template on a target that changes shape
# Sides per second since a target drawn by hand was last sure: what is followed instead leads away from it.
UNSURE_RATE = 2.0


def report(table: TargetTable, observation: Observation) -> tuple[Track, ...]:
    """Tracks of all targets but those without a detection that are unsettled, or at an unknown position.

    A detector misses an object for a frame or two; it is reported until it is dormant.
    """
    rows, are_objects = table.rows, table.are_objects
    hidden = rows["state"] == COASTING
    if hidden.any():
        hidden[hidden] = position_doubt(rows)[hidden] >= (OBJECT_DOUBT if are_objects else MAX_DOUBT)
    if are_objects:
        hidden &= table.dormant
    else:
        absent = (rows["frames_undetected"] > 0) | rows["crowded"]
        hidden |= absent & (rows["credit_s"] < SETTLED_S)
        hidden &= table.followed & ~rows["drawn"]
    index = np.flatnonzero(~hidden)
    rows, models = rows.take(index), [table.models[row] for row in index.tolist()]
    _, jacobians = map_points(observation.to_reference, rows["mean"][:, :2])
    velocities = np.matvec(jacobians, rows["mean"][:, 2:])
    velocities = np.where(np.isfinite(velocities), velocities, np.nan)
    tentative = np.array([model.template is None for model in models], np.bool_)
    # of the point in the target that its template sits on: no match corrects it
    sides = np.sqrt(rows["window"][:, 2] * rows["window"][:, 3])
    creep = np.array([model.evidence.usual_distance for model in models]) * CREEP
    creep += UNSURE_RATE * rows["unsure_s"]
    stds = np.where(rows["drawn"], DRAWN_STD + creep * sides, centroid_std(sides))
    covariances = np.where(tentative, 0.0, stds**2)[:, None, None] * IDENTITY
    # the window of a target drawn by hand is where it was recognised, else where it is predicted
    predicted = ~(rows["drawn"] & rows["recognised"] & (rows["state"] == CONFIRMED))
    covariances[predicted] += rows["covariance"][predicted, :2, :2]
    hits = rows["hits"][tentative]
    rows["score"][tentative] = (hits == 1.0).sum(axis=1) / (hits >= 0.0).sum(axis=1)  # NaN before it began
    rows["score"] = np.clip(rows["score"], 0.0, 1.0)
    # whole columns: reading one field of one row takes as long as reading all rows
    columns = zip(*(rows[name].tolist() for name in REPORTED), velocities.tolist(), covariances, strict=True)
    tracks = []
    for row in columns:
        number, state, window, score, age_s, point, detection, *found, shared, learnt, speed, covariance = row
        gate, similarity = (None if math.isnan(value) else value for value in found)
        provenance = Provenance(
            None if math.isnan(point[0]) else tuple(point),
            None if detection < 0 else detection,
            gate,
            shared,
            similarity,
            learnt,
            table.causes.get(number, ""),
        )
        x, y, length, width, angle = window
        box, velocity = (x, y, length, width, angle), (speed[0], speed[1])
        tracks.append(
            Track(number, STATES[state], *box, velocity, covariance, score, round(age_s * 1e9), provenance)
        )
    return tuple(tracks)
