"""Reports of targets in one frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from streamkit_tracker.delete.states import position_doubt
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import (
    COASTING,
    CONFIRMED,
    TargetModel,
    TargetRows,
    TargetState,
    TargetTable,
    dormant,
)
from streamkit_tracker.targets import centroid_std as detection_std
from streamkit_tracker.window_geometry import IDENTITY, FloatArray, map_points

STATES = tuple(TargetState)
LARGEST_DOUBT = 0.5  # sides; a dormant target whose position is less certain is kept without a report
MANUAL_STD = 0.1  # px, of a match with a target that keeps its appearance
CREEP = 0.35  # sides per unit of usual distance: how far a template comes to sit beside a soft target


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


def report(
    table: TargetTable, to_reference: FloatArray, settings: TrackerSettings
) -> tuple[TargetReport, ...]:
    """Reports of all targets but the dormant ones whose position is not known any more.

    Args:
        table: after this frame, with the targets that end in it.
        to_reference: float64[3, 3], this frame's pixels to the reference plane.
        settings: of the tracker.
    """
    coasting = table.rows["state"] == COASTING
    uncertain = position_doubt(table.rows) >= LARGEST_DOUBT
    index = np.flatnonzero(~(coasting & dormant(table.rows, settings.lost_frames) & uncertain))
    if not len(index):
        return ()
    rows, models = table.rows[index], [table.models[row] for row in index.tolist()]
    _, jacobians = map_points(to_reference, rows["mean"][:, :2])
    velocities = np.einsum("nij,nj->ni", jacobians, rows["mean"][:, 2:])
    velocities = np.where(np.isfinite(velocities), velocities, math.nan)
    variances = np.array(_anchor_variances(rows, models))
    covariances = variances[:, None, None] * IDENTITY
    # the window of a target drawn by hand is where it was recognised, else where it is predicted
    predicted = ~(rows["manual"] & rows["recognised"] & (rows["state"] == CONFIRMED))
    covariances[predicted] += rows["covariance"][predicted, :2, :2]
    return tuple(
        TargetReport(
            number,
            STATES[state],
            window,
            velocity,
            covariance,
            min(max(score if model.appearance is not None else sum(model.hits) / len(model.hits), 0.0), 1.0),
            age_s,
            provenance,
        )
        for number, state, window, velocity, covariance, score, age_s, model, provenance in zip(
            rows["id"].tolist(),
            rows["state"].tolist(),
            rows["window"],
            velocities,
            covariances,
            rows["score"].tolist(),
            rows["age_s"].tolist(),
            models,
            _provenances(rows, models),
            strict=True,
        )
    )


def _anchor_variances(rows: TargetRows, models: list[TargetModel]) -> list[float]:
    """Variances of the point in the target that its template sits on, px squared: no match corrects them."""
    variances = []
    sides = np.sqrt(rows["window"][:, 2] * rows["window"][:, 3]).tolist()
    for model, side, manual in zip(models, sides, rows["manual"].tolist(), strict=True):
        std = MANUAL_STD + CREEP * model.evidence.usual_distance * side if manual else detection_std(side)
        variances.append(0.0 if model.appearance is None else std**2)
    return variances


def _provenances(rows: TargetRows, models: list[TargetModel]) -> list[TargetProvenance]:
    columns = [
        rows[name].tolist() for name in ("predicted", "detection", "gate", "shared", "similarity", "learnt")
    ]
    return [
        TargetProvenance(
            None if math.isnan(x) else (x, y),
            None if detection < 0 else detection,
            None if math.isnan(gate) else gate,
            shared,
            None if math.isnan(similarity) else similarity,
            learnt,
            model.cause,
        )
        for (x, y), detection, gate, shared, similarity, learnt, model in zip(*columns, models, strict=True)
    ]
