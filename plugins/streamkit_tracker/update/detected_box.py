"""Size, position and angle of windows from upright detection boxes, once the direction of motion is known.

A detection shows where a target is and how large, but is noisy; the window, led by the target's appearance,
is steady but may sit on a part of the target or creep. The window is kept while both agree, and restarts on
the detections where they contradict it for some frames.
"""

from __future__ import annotations

import math

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.targets import TENTATIVE, IndexArray, TargetRows
from streamkit_tracker.update.expectations import SearchRows
from streamkit_tracker.update.turned_box import motion_heading, window_turn
from streamkit_tracker.window_geometry import (
    ANGLE,
    LENGTH,
    WIDTH,
    FloatArray,
    X,
    Y,
    half_turn,
)

KEEP, RESTART, RESTART_MOVED = range(3)
LEFT, TOP, RIGHT, BOTTOM = range(2, 6)  # of a detection; X and Y are its centroid

YOUNG_S = 1.0  # first detections often show a part only: until then size and position follow at once
RATED_S = 0.04  # the step that the rates are for
BOX_RATE, SHRINK_RATE, OBJECT_RATE = 0.15, 0.5, 0.4
OFFSET_RATE = 0.12
YOUNG_OFFSET, YOUNG_RESIZED = 0.1, 0.1  # relative to the side, and as a log ratio
RESIZED = 0.18  # log ratio of a side beyond which the window restarts
LEAST_OVERLAP, HARDLY_ANY_OVERLAP = 0.6, 0.35  # of window and detection, below which one of them is wrong
SAME_SIZE = 1.5
PATIENCE, ODD_SIZE_PATIENCE_S = 2, 0.32
UNRECOGNISED_BEFORE_RESTART = 3
TRUSTED = 0.3

REACH_PER_FRAME = 0.3
LONGEST_REACH = 3.0


@compiled
def follow_detections(
    targets: TargetRows, detected: FloatArray, step_s: float, are_objects: bool = False
) -> None:
    """Lets the boxes of detected targets follow detections, float64[d, 6], that show no other target.

    While a target is young its box is as long as was ever seen, or nearly.
    """
    for index in range(len(targets)):
        target = targets[index]
        if target["detection"] < 0:
            continue
        targets[index]["step_s"] = step_s
        if target["crowded"]:
            continue
        seen, box = detected[target["detection"]], target["box"]
        rate = _rate_for(BOX_RATE, step_s)
        for side in range(2):
            known, now = box[side], max(seen[RIGHT + side] - seen[LEFT + side], 1.0)
            if are_objects:
                rate = _rate_for(OBJECT_RATE, step_s)
            elif target["detected_s"] < YOUNG_S:
                rate = 1.0 if now > known else SHRINK_RATE
            box[side] = known * (now / known) ** rate
        targets[index]["detected_s"] = target["detected_s"] + step_s


@compiled
def expect(
    targets: TargetRows, searched: IndexArray, detected: FloatArray, step_s: float, searches: SearchRows
) -> None:
    """Fills in what is expected of targets that detections lead, but for the precisions.

    Args:
        targets: predicted for this frame.
        searched: intp[n], their rows.
        detected: float64[d, 6].
        step_s: s.
        searches: n rows of `SEARCH`.
    """
    for row in range(len(searched)):
        target, search = targets[searched[row]], searches[row]
        mean, covariance, window, box = target["mean"], target["covariance"], target["window"], target["box"]
        search["window"][:] = window
        seed, sides = search["seed"], search["sides"]
        for axis in range(2):
            search["displacement"][axis] = mean[2 + axis] * step_s
            seed[axis] = 0.0
        searches[row]["seed_std"] = np.inf
        if target["detection"] >= 0:
            seen = detected[target["detection"]]
            seed[0], seed[1] = seen[X], seen[Y]
            searches[row]["seed_std"] = target["detection_std"]
        searches[row]["spread"] = np.sqrt((covariance[0, 0] + covariance[1, 1]) / 2)
        searches[row]["reach"] = min(1 + REACH_PER_FRAME * target["frames_unseen"], LONGEST_REACH)
        side = np.sqrt(window[LENGTH] * window[WIDTH])
        heading, deviation = motion_heading(mean, covariance, side)
        if np.isnan(heading):
            heading = window[ANGLE]
        sides[0], sides[1], searches[row]["heading"] = window_turn(box[0], box[1], heading)
        searches[row]["heading_std"] = deviation


@compiled
def follow_objects(targets: TargetRows) -> None:
    """Sets the windows of targets whose detections are whole objects: upright, at the state's position.

    Targets that are tentative, drawn by hand or undetected are left alone.
    """
    for index in range(len(targets)):
        target = targets[index]
        targets[index]["restart"] = KEEP
        if target["manual"] or target["state"] == TENTATIVE or target["detection"] < 0:
            continue
        window, mean, box = target["window"], target["mean"], target["box"]
        window[0], window[1], window[2], window[3], window[4] = mean[0], mean[1], box[0], box[1], 0.0
        targets[index]["recognised"] = True


@compiled
def check_windows(targets: TargetRows, detected: FloatArray) -> None:
    """Decides which windows restart, for recognised or unrecognised targets with a detection of their own.

    Fills `restart` and `restart_window`: KEEP, RESTART at the state's position where the target was not
    recognised, or RESTART_MOVED where the state moves along.

    Args:
        targets: the table; `drawn by hand`, tentative and undetected rows are left alone.
        detected: float64[d, 6].
    """
    window = np.empty(5)
    for index in range(len(targets)):
        target = targets[index]
        targets[index]["restart"] = KEEP
        tentative = target["state"] == TENTATIVE
        if target["manual"] or tentative or target["detection"] < 0 or target["crowded"]:
            continue
        mean, box, better = target["mean"], target["box"], target["restart_window"]
        seen = detected[target["detection"]]
        window[:] = target["window"]
        if not target["recognised"]:
            window[:2] = mean[:2]
        side = np.sqrt(window[LENGTH] * window[WIDTH])
        heading, deviation = motion_heading(mean, target["covariance"], side)
        if np.isnan(heading):
            heading = window[ANGLE]
        trust = min(1.0, (1.0 + 0.04 * side) / target["detection_std"]) ** 2
        if target["recognised"]:
            targets[index]["unrecognised"] = 0.0
        elif not np.isnan(target["similarity"]):
            if trust > TRUSTED:
                targets[index]["unrecognised"] = target["unrecognised"] + 1.0
            if targets[index]["unrecognised"] >= UNRECOGNISED_BEFORE_RESTART:
                targets[index]["restart"] = RESTART
                better[0], better[1] = mean[0], mean[1]
                better[2], better[3], better[4] = window_turn(box[0], box[1], heading)
                continue
        if correct_window(targets[index : index + 1], window, seen, heading, deviation, trust):
            targets[index]["restart"] = RESTART_MOVED


@compiled
def correct_window(
    target: TargetRows,
    window: FloatArray,
    seen: FloatArray,
    heading: float,
    deviation: float,
    trust: float,
) -> bool:
    """Whether a window is wrong; then `restart_window` is filled.

    Args:
        target: its row, one of a table.
        window: float64[5].
        seen: float64[6], its detection.
        heading: direction of motion, rad.
        deviation: its standard deviation, rad.
        trust: in the detection, 0 to 1.
    """
    wrong = _is_wrong(target, window, seen, heading, deviation, trust)
    if wrong:
        target[0]["offset"][:] = 0.0
        target[0]["unrecognised"] = 0.0
        target[0]["misfits"] = 0.0
    return wrong


@compiled
def _is_wrong(
    target: TargetRows, window: FloatArray, seen: FloatArray, heading: float, deviation: float, trust: float
) -> bool:
    """Whether the window is wrong, and fills in where it would be right."""
    box, offset, better = target[0]["box"], target[0]["offset"], target[0]["restart_window"]
    x, y, length, width, angle = window
    side = math.sqrt(length * width)
    better[0], better[1] = (seen[LEFT] + seen[RIGHT]) / 2, (seen[TOP] + seen[BOTTOM]) / 2
    better[2], better[3], better[4] = window_turn(box[0], box[1], heading)
    resized = max(abs(math.log(better[LENGTH] / length)), abs(math.log(better[WIDTH] / width)))
    if target[0]["detected_s"] < YOUNG_S:
        off = np.hypot(better[0] - x, better[1] - y)
        return bool(off > YOUNG_OFFSET * side or resized > YOUNG_RESIZED)
    if _is_contradicted(target, window, seen):
        for axis in range(2):
            box[axis] = max(seen[RIGHT + axis] - seen[LEFT + axis], 1.0)
        better[2], better[3], better[4] = window_turn(box[0], box[1], heading)
        return True
    rate = trust * _rate_for(OFFSET_RATE, target[0]["step_s"])
    offset[0] += rate * (seen[X] - x - offset[0])
    offset[1] += rate * (seen[Y] - y - offset[1])
    better[0], better[1] = x + offset[0], y + offset[1]
    return bool(
        np.hypot(offset[0], offset[1]) > max(0.8, 0.06 * side)
        or abs(half_turn(better[ANGLE] - angle)) > max(0.25, 2.5 * deviation)
        or resized > RESIZED
    )


@compiled
def _is_contradicted(target: TargetRows, window: FloatArray, seen: FloatArray) -> bool:
    """Whether window and detection have been apart for so long that the window must be wrong."""
    box = target[0]["box"]
    width, height = max(seen[RIGHT] - seen[LEFT], 1.0), max(seen[BOTTOM] - seen[TOP], 1.0)
    ratio = width * height / (box[0] * box[1])
    overlap = _overlap(window, (seen[LEFT] + seen[RIGHT]) / 2, (seen[TOP] + seen[BOTTOM]) / 2, width, height)
    target[0]["misfits"] = 0.0 if overlap >= LEAST_OVERLAP else target[0]["misfits"] + 1.0
    usual = 1 / SAME_SIZE < ratio < SAME_SIZE
    patience = PATIENCE if usual else max(PATIENCE, np.rint(ODD_SIZE_PATIENCE_S / target[0]["step_s"]))
    return bool(target[0]["misfits"] >= patience or (usual and overlap < HARDLY_ANY_OVERLAP))


@compiled
def _overlap(window: FloatArray, middle_x: float, middle_y: float, width: float, height: float) -> float:
    """Intersection over union of a window's upright box and a detection's."""
    x, y, length, breadth, angle = window
    cosine, sine = abs(math.cos(angle)), abs(math.sin(angle))
    across, down = length * cosine + breadth * sine, length * sine + breadth * cosine
    shared_x = min((across + width) / 2 - abs(x - middle_x), across, width)
    shared_y = min((down + height) / 2 - abs(y - middle_y), down, height)
    common = max(shared_x, 0.0) * max(shared_y, 0.0)
    return float(common / (across * down + width * height - common))


@compiled
def _rate_for(rate: float, step_s: float) -> float:
    """A rate for steps of `RATED_S`, converted to another step."""
    return float(1.0 - (1.0 - rate) ** (step_s / RATED_S))
