"""Reports of targets in one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from streamkit_tracker.delete.states import position_doubt
from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import COASTING, CONFIRMED, TargetState, TargetTable, dormant
from streamkit_tracker.window_geometry import IDENTITY, FloatArray, map_points

STATES = tuple(TargetState)
# sides; a dormant target whose position is less certain is kept without a report
LARGEST_DOUBT, OBJECT_DOUBT = 0.5, 0.1
SETTLED_S = 1.0  # of detections beyond its gaps: boxes of false detections seldom last
MANUAL_STD = 0.1  # px, of a match with a target that keeps its appearance
CREEP = 0.35  # sides per unit of usual distance: drift of a template on a soft target


@dataclass
class TargetProvenance:
    """Where a target's row in one frame comes from.

    Attributes:
        predicted: x and y before the frame was searched, px; None in a target's first frame.
        detection: row of the frame's detections that was given to the target, or None.
        gate: distance of that detection from the predicted position, standard deviations.
        shared: whether the detection of another target covers this one too.
        similarity: of the best window to the template, 0 to 1; None where the pixels were not compared.
        learnt: whether the template took that window in.
        cause: why the target began, was confirmed or ended in this frame; else empty.
    """

    predicted: tuple[float, float] | None = None
    detection: int | None = None
    gate: float | None = None
    shared: bool = False
    similarity: float | None = None
    learnt: bool = False
    cause: str = ""


class TargetReport(msgspec.Struct, frozen=True, eq=False):
    """One target in one frame.

    Attributes:
        id: number, never reused.
        state: tentative, confirmed, coasting or lost.
        window: float64[5], x y length width angle in the frame's pixels.
        velocity: float64[2], px/s on the reference plane.
        covariance: float64[2, 2] of x and y, px squared.
        score: similarity of the window to the target's template, or share of frames detected, 0 to 1.
        age_s: time since the target began, s.
        provenance: where all this comes from.
    """

    id: int
    state: TargetState
    window: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    score: float
    age_s: float
    provenance: TargetProvenance = msgspec.field(default_factory=TargetProvenance)


REPORTED = (
    "id", "state", "score", "age_s", "predicted", "detection", "gate", "shared", "similarity", "learnt",
)  # fmt: skip


def report(
    table: TargetTable, observation: Observation, settings: TrackerSettings
) -> tuple[TargetReport, ...]:
    """Reports of all targets but the dormant ones whose position is not known any more.

    Args:
        table: after this frame, with the targets that end in it.
        observation: of this frame.
        settings: of the tracker.
    """
    hidden = (table.rows["state"] == COASTING) & dormant(table.rows, settings.lost_frames)
    if hidden.any():
        doubt = position_doubt(table.rows)
        is_unknown = (doubt >= OBJECT_DOUBT) | (table.rows["credit_s"] < SETTLED_S)
        hidden &= np.where(table.rows["whole"], is_unknown, doubt >= LARGEST_DOUBT)
    index = np.flatnonzero(~hidden)
    if not len(index):
        return ()
    rows, models = table.rows[index], [table.models[row] for row in index.tolist()]
    _, jacobians = map_points(observation.to_reference, rows["mean"][:, :2])
    velocities = np.einsum("nij,nj->ni", jacobians, rows["mean"][:, 2:])
    velocities = np.where(np.isfinite(velocities), velocities, math.nan)
    sides = np.sqrt(rows["window"][:, 2] * rows["window"][:, 3]).tolist()
    tentative = np.array([model.appearance is None for model in models])
    # of the point in the target that its template sits on: no match corrects it
    stds = [
        MANUAL_STD + CREEP * model.evidence.usual_distance * side if manual else 1.0 + 0.04 * side
        for model, side, manual in zip(models, sides, rows["manual"].tolist(), strict=True)
    ]
    covariances = np.where(tentative, 0.0, [std**2 for std in stds])[:, None, None] * IDENTITY
    # the window of a target drawn by hand is where it was recognised, else where it is predicted
    predicted = ~(rows["manual"] & rows["recognised"] & (rows["state"] == CONFIRMED))
    covariances[predicted] += rows["covariance"][predicted, :2, :2]
    scores = rows["score"]
    scores[tentative] = np.nanmean(rows["hits"][tentative], axis=1)
    # whole columns: reading one field of one row takes as long as reading all rows
    columns = (rows[name].tolist() for name in REPORTED)
    reports = []
    for window, velocity, covariance, values in zip(
        rows["window"], velocities, covariances, zip(*columns, strict=True), strict=True
    ):
        number, state, score, age_s, (x, y), detection, gate, shared, similarity, learnt = values
        provenance = TargetProvenance(
            None if math.isnan(x) else (x, y),
            None if detection < 0 else detection,
            None if math.isnan(gate) else gate,
            shared,
            None if math.isnan(similarity) else similarity,
            learnt,
            table.causes.get(number, ""),
        )
        state, score = STATES[state], min(max(score, 0.0), 1.0)
        reports.append(TargetReport(number, state, window, velocity, covariance, score, age_s, provenance))
    return tuple(reports)
