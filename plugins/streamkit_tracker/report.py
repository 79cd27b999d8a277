"""Reports of targets in one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from streamkit_tracker.delete import position_doubt
from streamkit_tracker.observation import Observation
from streamkit_tracker.targets import (
    COASTING,
    CONFIRMED,
    SETTLED_S,
    TargetState,
    TargetTable,
    centroid_std,
)
from streamkit_tracker.window_geometry import IDENTITY, FloatArray, map_points

STATES = tuple(TargetState)
REPORTED = (
    "id", "state", "score", "age_s", "predicted", "detection", "gate", "similarity", "shared", "learnt",
)  # fmt: skip
# sides; a target that coasts at a position less certain is kept without a report
MAX_DOUBT, OBJECT_DOUBT = 0.5, 0.1
DRAWN_STD = 0.1  # px, of a match with a target that keeps its appearance
CREEP = 0.35  # sides per unit of usual distance: drift of a template on a target that changes shape


@dataclass
class TargetProvenance:
    """Where a target's row in one frame comes from: the fields of `streamkit.Provenance`."""

    predicted: tuple[float, float] | None = None
    detection: int | None = None
    shared: bool = False
    gate: float | None = None
    similarity: float | None = None
    learnt: bool = False
    cause: str = ""


class TargetReport(msgspec.Struct, frozen=True, eq=False):
    """One target in one frame: see `streamkit.Track`.

    Attributes:
        window: float64[5], x y length width angle in the frame's pixels.
        velocity: float64[2], px/s on the reference plane.
        covariance: float64[2, 2] of x and y, px squared.
        score: similarity of the window to the target's template, or share of frames detected, 0 to 1.
    """

    id: int
    state: TargetState
    window: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    score: float
    age_s: float
    provenance: TargetProvenance


def report(table: TargetTable, observation: Observation) -> tuple[TargetReport, ...]:
    """Reports of all targets but those without a detection that are unsettled, or at an unknown position.

    A detector misses an object for a frame or two; it is reported until it is dormant.
    """
    rows, are_objects = table.rows, table.are_objects
    hidden = rows["state"] == COASTING
    if hidden.any():
        hidden[hidden] = position_doubt(rows[hidden]) >= (OBJECT_DOUBT if are_objects else MAX_DOUBT)
    if are_objects:
        hidden &= table.dormant
    else:
        absent = (rows["frames_undetected"] > 0) | rows["crowded"]
        hidden |= absent & (rows["credit_s"] < SETTLED_S)
        hidden &= table.followed & ~rows["drawn"]
    index = np.flatnonzero(~hidden)
    rows, models = rows[index], [table.models[row] for row in index.tolist()]
    _, jacobians = map_points(observation.to_reference, rows["mean"][:, :2])
    velocities = np.matvec(jacobians, rows["mean"][:, 2:])
    velocities = np.where(np.isfinite(velocities), velocities, np.nan)
    tentative = np.array([model.template is None for model in models], np.bool_)
    # of the point in the target that its template sits on: no match corrects it
    sides = np.sqrt(rows["window"][:, 2] * rows["window"][:, 3])
    creep = np.array([model.evidence.usual_distance for model in models]) * CREEP
    stds = np.where(rows["drawn"], DRAWN_STD + creep * sides, centroid_std(sides))
    covariances = np.where(tentative, 0.0, stds**2)[:, None, None] * IDENTITY
    # the window of a target drawn by hand is where it was recognised, else where it is predicted
    predicted = ~(rows["drawn"] & rows["recognised"] & (rows["state"] == CONFIRMED))
    covariances[predicted] += rows["covariance"][predicted, :2, :2]
    if tentative.any():
        rows["score"][tentative] = np.nanmean(rows["hits"][tentative], axis=1)
    rows["score"] = np.clip(rows["score"], 0.0, 1.0)
    # whole columns: reading one field of one row takes as long as reading all rows
    columns = zip(*(rows[name].tolist() for name in REPORTED), strict=True)
    reports = []
    for row, (number, state, score, age_s, point, detection, *found, shared, learnt) in enumerate(columns):
        gate, similarity = (None if math.isnan(value) else value for value in found)
        provenance = TargetProvenance(
            None if math.isnan(point[0]) else tuple(point),
            None if detection < 0 else detection,
            shared,
            gate,
            similarity,
            learnt,
            table.causes.get(number, ""),
        )
        at = rows["window"][row], velocities[row], covariances[row]
        reports.append(TargetReport(number, STATES[state], *at, score, age_s, provenance))
    return tuple(reports)
