"""Decides which targets are confirmed, coast or end in a frame."""

from __future__ import annotations

import numpy as np

from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import (
    COASTING,
    CONFIRMED,
    LOST,
    TENTATIVE,
    TargetRows,
    TargetTable,
    followed,
)
from streamkit_tracker.window_geometry import (
    ANGLE,
    LENGTH,
    WIDTH,
    FloatArray,
    visible_fraction,
)

LEAST_VISIBLE = 0.3
TENTATIVE_MISSES = 2


def coast_all(table: TargetTable) -> None:
    """Moves every target by its prediction, in a frame that cannot be searched."""
    rows = table.rows
    displacements = rows["mean"][:, :2] - rows["window"][:, :2]
    rows["window"][:, :2] += displacements
    for model, displacement in zip(table.models, displacements, strict=True):
        if model.appearance is not None:
            particles = model.appearance.particles
            particles.positions = particles.positions + displacement
    known = followed(rows)
    rows["state"][known] = COASTING
    missed = ~known & (rows["frames_undetected"] > TENTATIVE_MISSES)
    for index in np.flatnonzero((rows["credit_s"] <= 0) | missed).tolist():
        table.lose(index, "coasted too long without registration")


def end_gone(table: TargetTable, settings: TrackerSettings, shape: tuple[int, int]) -> None:
    """Ends targets that left the frame or coasted too long, and sets the state of the others.

    Args:
        table: updated.
        settings: of the tracker.
        shape: height and width of the frame, px.
    """
    rows = table.rows
    known = followed(rows)
    decide_states(rows, settings.coast, settings.lost_frames, shape)
    for index in np.flatnonzero(rows["state"] == LOST).tolist():
        cause = "left the frame" if rows["visible"][index] < LEAST_VISIBLE else "coasted too long"
        table.lose(index, cause if known[index] else "not detected again before it was confirmed")


def end_surplus(table: TargetTable, max_targets: int) -> int:
    """Ends the least certain followed targets, those that coast first, so that `max_targets` are left.

    Returns:
        The number of targets that end.
    """
    rows = table.rows
    known = followed(rows)
    surplus = int(np.count_nonzero(known)) - max_targets
    if surplus <= 0:
        return 0
    doubts, coasting = position_doubt(rows).tolist(), (rows["state"] == COASTING).tolist()
    movable = np.flatnonzero(known & ~rows["manual"]).tolist()
    chosen = sorted(movable, key=lambda index: (coasting[index], doubts[index]), reverse=True)[:surplus]
    for index in chosen:
        table.lose(index, "made room: max-targets were followed")
    return len(chosen)


def position_doubt(rows: TargetRows) -> FloatArray:
    """Standard deviations of the positions relative to the targets' sides, float64[n]."""
    covariance, window = rows["covariance"], rows["window"]
    deviations = np.sqrt((covariance[:, 0, 0] + covariance[:, 1, 1]) / 2)
    return np.asarray(deviations / np.sqrt(window[:, 2] * window[:, 3]))


def begin_frame(targets: TargetRows) -> None:
    """Resets the fields of the last frame; the predicted position is the mean."""
    targets["predicted"] = targets["mean"][:, :2]
    targets["detection"] = -1
    for name, value in (
        ("gate", np.nan), ("similarity", np.nan), ("crowded", False), ("shared", False),
        ("recognised", False), ("learnt", False), ("measured", False), ("filter_share", 0.0),
    ):  # fmt: skip
        targets[name] = value


def pass_time(targets: TargetRows, step_s: float, coast: float, birth_window: int) -> None:
    """Counts one frame for every target, with or without a detection.

    Args:
        targets: with the detections of this frame.
        step_s: s.
        coast: longest time a target may coast, s.
        birth_window: frames in which detections count before a target is confirmed.
    """
    detected, hits = (targets["detection"] >= 0) | targets["shared"], targets["hits"]
    hits[:, 1:birth_window] = hits[:, : birth_window - 1].copy()
    hits[:, 0] = detected
    targets["age_s"] += step_s
    targets["frames_undetected"] = np.where(detected, 0, targets["frames_undetected"] + 1)
    targets["credit_s"] = np.minimum(targets["credit_s"] + np.where(detected, step_s, -step_s), coast)


def decide_states(targets: TargetRows, coast: float, lost_frames: int, image_shape: tuple[int, int]) -> None:
    """Sets the windows and states of all targets.

    Args:
        targets: corrected, with the windows that restart.
        coast: longest time a target drawn by hand may coast, s.
        lost_frames: unseen frames from which only a detection finds a target again.
        image_shape: height and width of the frame, px.
    """
    targets["visible"] = visible_fraction(targets["window"], image_shape)
    tentative, restarted = targets["state"] == TENTATIVE, targets["restart"].copy()
    window, mean, manual = targets["window"], targets["mean"], targets["manual"]
    recognised = targets["recognised"] & ~tentative
    window[~recognised, :2] = mean[~recognised, :2]
    window[tentative, LENGTH : WIDTH + 1], window[tentative, ANGLE] = targets["box"][tentative], 0.0
    restarted &= ~tentative
    window[restarted], targets["score"][restarted] = targets["restart_window"][restarted], 1.0
    mean[restarted, :2] = window[restarted, :2]
    recognised |= restarted
    seen = recognised | (targets["frames_undetected"] == 0)
    targets["frames_unseen"] = np.where(seen | tentative, 0, targets["frames_unseen"] + 1)
    targets["credit_s"][manual & recognised] = coast
    believed = np.where(manual, targets["sure"], targets["frames_undetected"] < lost_frames)
    confirmed = (targets["detection"] >= 0) & ~targets["crowded"] | recognised & believed
    gone = np.where(
        tentative,
        targets["frames_undetected"] > TENTATIVE_MISSES,
        (targets["visible"] < LEAST_VISIBLE) | (targets["credit_s"] <= 0),
    )
    states = np.where(tentative, TENTATIVE, np.where(confirmed, CONFIRMED, COASTING))
    targets["state"] = np.where(gone, LOST, states)
