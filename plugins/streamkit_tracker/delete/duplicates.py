"""Ends the younger of two targets that are on one object."""

from __future__ import annotations

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.observation import Observation
from streamkit_tracker.targets import IndexArray, TargetRows, TargetTable, dormant, followed
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray, IntArray, is_inside

MERGE_FRAMES = 3
MERGE_SCALE = 0.9
FRAGMENT_AREA = 3.5
SETTLED_S = 1.0  # time with detections of its own after which a target is no fragment

Closeness = dict[tuple[int, int], int]


def end_duplicates(
    table: TargetTable, observation: Observation, lost_frames: int, closeness: Closeness
) -> Closeness:
    """Ends the younger of two targets that were on one object, with one velocity, for some frames.

    Args:
        table: of the targets.
        observation: of this frame; two objects with a detection each are two, however near.
        lost_frames: see `dormant`.
        closeness: for how many frames pairs of ids have been on one object.

    Returns:
        The same up to this frame.
    """
    rows = table.rows
    members = np.flatnonzero(followed(rows) & ~dormant(rows, lost_frames))
    if len(members) < 2:
        return {}
    pairs = np.empty((len(members) * (len(members) - 1) // 2, 2), np.int64)
    found: Closeness = {}
    count = find_duplicates(rows, members, observation.boxes, pairs, observation.are_objects)
    for older, younger in pairs[:count].tolist():
        both = (int(rows["id"][older]), int(rows["id"][younger]))
        found[both] = closeness.get(both, 0) + 1
        if found[both] >= MERGE_FRAMES:
            table.lose(younger, f"was on the same object as {both[0]}")
    return found


@compiled
def find_duplicates(
    targets: TargetRows, members: IndexArray, boxes: FloatArray, pairs: IntArray, are_objects: bool
) -> int:
    """Fills in pairs of rows, the older first, that are on one object; returns their number."""
    count = 0
    for first in range(len(members)):
        older = targets[members[first]]
        for second in range(first + 1, len(members)):
            younger = targets[members[second]]
            if are_objects and older["detection"] >= 0 and younger["detection"] >= 0:
                continue
            x, y = older["mean"][2] - younger["mean"][2], older["mean"][3] - younger["mean"][3]
            if np.sqrt(x * x + y * y) >= max(_velocity_doubt(older), _velocity_doubt(younger)):
                continue
            if (
                is_inside(older["window"][0], older["window"][1], younger["window"], MERGE_SCALE)
                or is_inside(younger["window"][0], younger["window"][1], older["window"], MERGE_SCALE)
                or _is_fragment(older, younger, boxes)
            ):
                pairs[count, 0], pairs[count, 1] = members[first], members[second]
                count += 1
    return count


@compiled
def _velocity_doubt(target: TargetRows) -> float:
    """Difference of velocities that says nothing, px/s."""
    covariance, window = target["covariance"], target["window"]
    deviation = np.sqrt((covariance[2, 2] + covariance[3, 3]) / 2)
    return float(np.sqrt(window[LENGTH] * window[WIDTH]) + deviation)


@compiled
def _is_fragment(older: TargetRows, younger: TargetRows, boxes: FloatArray) -> bool:
    """Whether one detection holds both targets, and the younger was hardly ever detected alone."""
    if younger["manual"] or younger["detected_s"] >= SETTLED_S:
        return False
    area = older["box"][0] * older["box"][1]
    for index in range(len(boxes)):
        box = boxes[index]
        # a detection several times larger than the older target may well show two
        if not (box[2] - box[0]) * (box[3] - box[1]) < FRAGMENT_AREA * area or not np.isfinite(box).all():
            continue
        if _holds(box, older["window"]) and _holds(box, younger["window"]):
            return True
    return False


@compiled
def _holds(box: FloatArray, window: FloatArray) -> bool:
    return bool(box[0] <= window[0] <= box[2] and box[1] <= window[1] <= box[3])
