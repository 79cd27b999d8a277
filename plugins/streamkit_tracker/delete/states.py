"""Decides which targets are confirmed, coast or end in a frame."""

from __future__ import annotations

import numpy as np

from streamkit_kernels import compiled
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
from streamkit_tracker.update.detected_box import KEEP, RESTART_MOVED
from streamkit_tracker.window_geometry import FloatArray, is_inside, visible_part

LEAST_VISIBLE = 0.3
HIDDEN_SCALE = 2.0
TENTATIVE_MISSES = 2
CREDIT_RATE = 1.0


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
    decide_states(rows, settings.coast, settings.lost_frames, *shape)
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


@compiled
def begin_frame(targets: TargetRows) -> None:
    """Resets the fields of the last frame; the predicted position is the mean."""
    for index in range(len(targets)):
        target = targets[index]
        target["predicted"][:] = target["mean"][:2]
        targets[index]["detection"] = -1
        targets[index]["gate"] = targets[index]["similarity"] = np.nan
        targets[index]["crowded"] = targets[index]["shared"] = False
        targets[index]["recognised"] = targets[index]["learnt"] = targets[index]["measured"] = False
        targets[index]["filter_share"] = 0.0


@compiled
def pass_time(targets: TargetRows, step_s: float, coast: float, birth_window: int) -> None:
    """Counts one frame for every target, with or without a detection.

    Args:
        targets: with the detections of this frame.
        step_s: s.
        coast: longest time a target may coast, s.
        birth_window: frames in which detections count before a target is confirmed.
    """
    for index in range(len(targets)):
        target = targets[index]
        detected, hits = target["detection"] >= 0 or target["shared"], target["hits"]
        for place in range(birth_window - 1, 0, -1):
            hits[place] = hits[place - 1]
        hits[0] = 1.0 if detected else 0.0
        targets[index]["age_s"] = target["age_s"] + step_s
        targets[index]["frames_undetected"] = 0 if detected else target["frames_undetected"] + 1
        gain = CREDIT_RATE if detected else -1.0
        targets[index]["credit_s"] = min(target["credit_s"] + gain * step_s, coast)


@compiled
def decide_states(targets: TargetRows, coast: float, lost_frames: int, height: int, width: int) -> None:
    """Sets the windows and states of all targets.

    Args:
        targets: corrected, with the windows that restart.
        coast: longest time a target drawn by hand may coast, s.
        lost_frames: unseen frames from which only a detection finds a target again.
        height: of the frame, px.
        width: of the frame, px.
    """
    find_hidden(targets, lost_frames, height, width)
    for index in range(len(targets)):
        target = targets[index]
        mean, window, detected = target["mean"], target["window"], target["detection"] >= 0
        if target["state"] == TENTATIVE:
            window[0], window[1], window[4] = mean[0], mean[1], 0.0
            window[2], window[3] = target["box"][0], target["box"][1]
            if target["frames_undetected"] > TENTATIVE_MISSES:
                targets[index]["state"] = LOST
            continue
        recognised = target["recognised"]
        if not recognised:
            window[:2] = mean[:2]
        if target["restart"] != KEEP:
            window[:] = target["restart_window"]
            recognised, targets[index]["score"] = True, 1.0
            if target["restart"] == RESTART_MOVED:
                mean[:2] = window[:2]
        if recognised or target["frames_undetected"] == 0:
            targets[index]["frames_unseen"] = 0
        elif not target["hidden"]:
            targets[index]["frames_unseen"] = target["frames_unseen"] + 1
        if target["manual"] and recognised:
            targets[index]["credit_s"] = coast
        believed = target["sure"] if target["manual"] else target["frames_undetected"] < lost_frames
        seen = (detected and not target["crowded"]) or (recognised and believed)
        targets[index]["state"] = CONFIRMED if seen else COASTING
        if target["visible"] < LEAST_VISIBLE or targets[index]["credit_s"] <= 0:
            targets[index]["state"] = LOST


@compiled
def find_hidden(targets: TargetRows, lost_frames: int, height: int, width: int) -> None:
    """Fills in how much of each window is visible, and whether another target lies upon it.

    Args:
        targets: the table.
        lost_frames: unseen frames from which a target hides no other.
        height: of the frame, px.
        width: of the frame, px.
    """
    for index in range(len(targets)):
        window = targets[index]["window"]
        targets[index]["visible"] = visible_part(window, height, width)
        targets[index]["hidden"] = False
        for other in range(len(targets)):
            above = targets[other]
            known = above["state"] == CONFIRMED or above["state"] == COASTING
            if other == index or not known or (not above["manual"] and above["frames_unseen"] >= lost_frames):
                continue
            if is_inside(window[0], window[1], above["window"], HIDDEN_SCALE):
                targets[index]["hidden"] = True
