"""Decides which targets are confirmed, coast or end in a frame."""

from __future__ import annotations

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.targets import COASTING, CONFIRMED, TENTATIVE, BoolArray, TargetRows, TargetTable
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, FloatArray, is_inside, visible_fraction

MIN_VISIBLE = 0.3  # part of a window in the frame: of the rest a search sees the repeated edge
MERGE_FRAMES = 3  # in a row: a position or a velocity that is wrong once ends no target
MERGE_SCALE = 0.9  # of the sides: a centre at the rim of a window may be that of a neighbour


def coast_all(table: TargetTable) -> None:
    """Moves every target by its prediction, in a frame that cannot be searched."""
    rows = table.rows
    displacements = rows["mean"][:, :2] - rows["window"][:, :2]
    rows["window"][:, :2] += displacements
    for model, displacement in zip(table.models, displacements, strict=True):
        if model.particles is not None:
            model.particles.positions = model.particles.positions + displacement
    rows["state"][table.followed] = COASTING
    for index in np.flatnonzero(rows["credit_s"] <= 0).tolist():
        table.lose(index, "coasted too long without registration")


def end_gone(table: TargetTable, image_shape: tuple[int, int]) -> None:
    """Sets the windows and states of all targets, and ends those that left the frame or coasted too long."""
    targets, settings, followed = table.rows, table.settings, table.followed
    targets["visible"] = visible_fraction(targets["window"], image_shape)
    tentative = targets["state"] == TENTATIVE
    window, mean, drawn = targets["window"], targets["mean"], targets["drawn"]
    recognised = targets["recognised"] & ~tentative
    window[~recognised, :2] = mean[~recognised, :2]
    window[tentative, LENGTH : WIDTH + 1], window[tentative, ANGLE] = targets["box"][tentative], 0.0
    seen = recognised | (targets["frames_undetected"] == 0)
    targets["frames_unseen"] = np.where(seen | tentative, 0, targets["frames_unseen"] + targets["detectable"])
    targets["credit_s"][drawn & recognised] = settings.coast
    believed = np.where(drawn, targets["sure"], targets["frames_undetected"] < settings.lost_frames)
    confirmed = (targets["detection"] >= 0) & ~targets["crowded"] | recognised & believed
    # a target drawn by hand that is not sure may be elsewhere: its detector goes on looking for it
    has_left = (targets["visible"] < MIN_VISIBLE) & (~drawn | targets["sure"])
    # so many misses in a row leave the window too few detections
    missed = targets["frames_undetected"] > max(settings.birth_window - settings.birth_hits, 0)
    gone = np.where(tentative, missed, has_left | (targets["credit_s"] <= 0))
    targets["state"] = np.where(tentative, TENTATIVE, np.where(confirmed, CONFIRMED, COASTING))
    if not table.are_objects:
        table.survival.learn(targets["detections"][gone & ~has_left & ~drawn], ended=True)
    for index in np.flatnonzero(gone).tolist():
        cause = "left the frame" if has_left[index] else "coasted too long"
        table.lose(index, cause if followed[index] else "not detected again before it was confirmed")


def end_surplus(table: TargetTable) -> int:
    """Ends the least certain followed targets, those that coast first, so that `max_targets` are left.

    Returns:
        The number of targets that end.
    """
    rows = table.rows
    followed = table.followed
    surplus = int(np.count_nonzero(followed)) - table.settings.max_targets
    if surplus <= 0:
        return 0
    doubts, coasting = position_doubt(rows).tolist(), (rows["state"] == COASTING).tolist()
    movable = np.flatnonzero(followed & ~rows["drawn"]).tolist()
    chosen = sorted(movable, key=lambda index: (coasting[index], doubts[index]), reverse=True)[:surplus]
    for index in chosen:
        table.lose(index, "made room: max-targets were followed")
    return len(chosen)


def end_duplicates(table: TargetTable) -> None:
    """Ends the younger of two targets that were on one object, with one velocity, for some frames.

    What a detection shows whole is no duplicate, whatever lies upon it.
    """
    members = np.flatnonzero(table.followed & ~table.dormant)
    rows, known, table.closeness = table.rows.take(members), table.closeness, {}
    for older, younger in np.argwhere(find_close(rows)).tolist():
        both = (rows["id"].item(older), rows["id"].item(younger))
        table.closeness[both] = known.get(both, 0) + 1
        if table.closeness[both] >= MERGE_FRAMES:
            table.lose(members.item(younger), f"was on the same object as {both[0]}")


@compiled
def find_close(rows: TargetRows) -> BoolArray:
    """Which targets, in rows, a younger one, in columns, moves with and is on: bool[n, n]."""
    close, doubt = np.zeros((len(rows), len(rows)), np.bool_), np.empty(len(rows))
    for younger in range(len(rows)):
        new = rows[younger]
        variance = (new["covariance"][2, 2] + new["covariance"][3, 3]) / 2
        # differences of velocities below this say nothing, px/s
        doubt[younger] = np.sqrt(new["window"][LENGTH] * new["window"][WIDTH]) + np.sqrt(variance)
        for older in range(younger):
            old = rows[older]
            apart = np.hypot(new["mean"][2] - old["mean"][2], new["mean"][3] - old["mean"][3])
            if apart < max(doubt[younger], doubt[older]) and not (new["whole"] and new["detection"] >= 0):
                is_on = is_inside(new["window"][0], new["window"][1], old["window"], MERGE_SCALE)
                close[older, younger] = is_on or is_inside(
                    old["window"][0], old["window"][1], new["window"], MERGE_SCALE
                )
    return close


def position_doubt(rows: TargetRows) -> FloatArray:
    """Standard deviations of the positions relative to the targets' sides, float64[n]."""
    covariance, window = rows["covariance"], rows["window"]
    deviations = np.sqrt((covariance[:, 0, 0] + covariance[:, 1, 1]) / 2)
    return np.asarray(deviations / np.sqrt(window[:, 2] * window[:, 3]))


def pass_time(table: TargetTable, step_s: float, detector_ran: bool) -> None:
    """Counts one frame of `step_s` seconds for every target, with or without a detection.

    A frame on which no detector ran misses no target: its time counts with the next one on which one did.
    """
    targets, birth_window = table.rows, table.settings.birth_window
    targets["detectable"] = detectable = targets["drawn"] | detector_ran
    detected, hits = targets["detection"] >= 0, targets["hits"]
    hits[detectable, 1:birth_window] = hits[detectable, : birth_window - 1]
    hits[detectable, 0] = detected[detectable]
    if not table.are_objects:
        table.survival.learn(targets["detections"][detected & ~targets["drawn"]], ended=False)
    targets["detections"] += detected
    targets["age_s"] += step_s
    targets["waited_s"] += step_s
    targets["unsure_s"] += step_s
    passed_s = np.where(detectable, targets["waited_s"], 0.0)
    targets["waited_s"][detectable] = 0.0
    targets["frames_undetected"] = np.where(detected, 0, targets["frames_undetected"] + detectable)
    coast = table.settings.coast
    earned_s = coast if table.are_objects else passed_s * ~targets["shared"]
    targets["credit_s"] = np.minimum(
        targets["credit_s"] + np.where(detected, earned_s, -passed_s), coast - targets["waited_s"]
    )
