"""Size, position and angle of windows from upright detection boxes, once the direction of motion is known.

A detection shows where a target is and how large, but is noisy; the window, led by the target's appearance,
is steady but may sit on a part of the target or creep. The window is kept while both agree, and restarts on
the detections where they contradict it for some frames.
"""

from __future__ import annotations

import numpy as np

from streamkit_tracker.targets import TENTATIVE, BoolArray, TargetRows, centroid_std
from streamkit_tracker.window_geometry import (
    ANGLE,
    LENGTH,
    MINIMUM_SIDE,
    WIDTH,
    FloatArray,
    half_turn,
    upright_sides,
)

LEFT, RIGHT = 2, 4  # of a detection; before it are x and y of its centroid, behind each its y

YOUNG_S = 1.0  # first detections often show a part only: until then size and position follow at once
RATED_S = 0.04  # the step that the rates are for
BOX_RATE, OBJECT_RATE = 0.15, 0.4
OFFSET_RATE = 0.12
YOUNG_OFFSET, YOUNG_RESIZED = 0.1, 0.1  # relative to the side, and as a log ratio
RESIZED = 0.18  # log ratio of a side beyond which the window restarts
MISFITS_BEFORE_RESTART = 2
MIN_OVERLAP = 0.6  # of window and detection
# Side of a region, px, from which its outline places a target no worse than a template of 32 px does; below
# the second one the target follows its template again.
LARGE_SIDE, SMALL_SIDE = 32.0, 26.0
KNOWN_SPEED = 3.0  # standard deviations of the speed from which its direction is known
MIN_SPEED = 0.3  # sides per second, likewise
MIN_HEADING_STD = 0.08  # rad
USUAL_ASPECT = 2.0
ASPECT_WEIGHT = 0.3
MAX_ASPECT = 5.0
MAX_DISAGREEMENT = 2.0  # standard deviations of a detection


def follow_detections(
    targets: TargetRows, detected: FloatArray, step_s: float, are_objects: bool = False
) -> None:
    """Lets boxes follow the detections float64[d, 6] that show no other target, and sets `whole`.

    The box is that of the detection while a target is young, and where a large region shows it whole; the
    boxes of a detector (`are_objects`) are smoothed. Targets drawn by hand are never whole; all others are
    with a detector, else the large ones.
    """
    index = np.flatnonzero((targets["detection"] >= 0) & ~targets["crowded"])
    rows = targets[index]
    known, now = rows["box"], detected_sides(detected[rows["detection"]])
    rates = np.where(rows["detected_s"] < YOUNG_S, 1.0, rate_for(BOX_RATE, step_s))
    rates[rows["whole"]] = rate_for(OBJECT_RATE, step_s) if are_objects else 1.0
    targets["box"][index] = known * (now / known) ** rates[:, None]
    targets["detected_s"][index] += step_s
    areas = targets["box"].prod(axis=1)
    is_large = areas >= np.where(targets["whole"], SMALL_SIDE, LARGE_SIDE) ** 2
    targets["whole"] = ~targets["manual"] & (are_objects | is_large)


def follow_boxes(targets: TargetRows, detected: FloatArray, are_objects: bool) -> None:
    """Sets the windows of detected targets that detections float64[d, 6] show whole.

    Boxes of a detector are smoothed and stay upright. A region of motion is the window itself, turned into
    the motion where that is known. Tentative and undetected targets are left alone.
    """
    index = np.flatnonzero(targets["whole"] & (targets["state"] != TENTATIVE) & (targets["detection"] >= 0))
    if not len(index):
        return
    rows = targets[index]
    if are_objects:
        targets["window"][index] = np.column_stack([rows["mean"][:, :2], rows["box"], np.zeros(len(index))])
    else:
        seen = detected[rows["detection"]]
        headings, _ = motion_headings(rows["mean"], rows["covariance"], rows["window"])
        middle = (seen[:, LEFT:RIGHT] + seen[:, RIGHT:]) / 2
        targets["window"][index] = turned_windows(middle, detected_sides(seen), headings)
    targets["recognised"][index] = True


def check_windows(targets: TargetRows, detected: FloatArray, step_s: float) -> None:
    """Decides which windows are wrong: sets `restart`, and `restart_window` where they would be right.

    Only targets with one of the detections float64[d, 6] of their own are changed; those drawn by hand and
    tentative ones are not.
    """
    targets["restart"] = False
    awake = ~targets["manual"] & ~targets["whole"] & (targets["state"] != TENTATIVE)
    index = np.flatnonzero(awake & (targets["detection"] >= 0) & ~targets["crowded"])
    if not len(index):
        return
    rows = targets[index]
    seen, window, mean = detected[rows["detection"]], rows["window"], rows["mean"]
    window[:, :2] = np.where(rows["recognised"][:, None], window[:, :2], mean[:, :2])
    headings, deviations = motion_headings(mean, rows["covariance"], window)
    sides = np.sqrt(window[:, LENGTH] * window[:, WIDTH])
    middle, young = (seen[:, LEFT:RIGHT] + seen[:, RIGHT:]) / 2, rows["detected_s"] < YOUNG_S
    trust = np.minimum(1.0, centroid_std(sides) / rows["detection_std"]) ** 2
    rate = np.where(young, 0.0, trust * rate_for(OFFSET_RATE, step_s))[:, None]
    offset = rows["offset"] + rate * (seen[:, :2] - window[:, :2] - rows["offset"])
    misfits = np.where(young | (_overlaps(window, seen) >= MIN_OVERLAP), 0, rows["misfits"] + 1)
    beside = misfits >= MISFITS_BEFORE_RESTART
    box = np.where(beside[:, None], detected_sides(seen), rows["box"])
    centres = np.where((young | beside)[:, None], middle, window[:, :2] + offset)
    better = turned_windows(centres, box, headings)
    wrong = beside | _disagree(window, better, young, deviations)
    targets["restart"][index], targets["restart_window"][index] = wrong, better
    targets["box"][index], targets["misfits"][index] = box, np.where(wrong, 0, misfits)
    targets["offset"][index] = np.where(wrong[:, None], 0.0, offset)


def _disagree(window: FloatArray, better: FloatArray, young: BoolArray, deviations: FloatArray) -> BoolArray:
    """Which windows float64[n, 5] differ too much from better ones, which young targets follow at once.

    The angles have the standard deviations float64[n].
    """
    sides = np.sqrt(window[:, LENGTH] * window[:, WIDTH])
    apart = np.hypot(*(better[:, :2] - window[:, :2]).T)
    resized = np.abs(np.log(better[:, LENGTH : WIDTH + 1] / window[:, LENGTH : WIDTH + 1])).max(axis=1)
    turned = np.abs(half_turn(better[:, ANGLE] - window[:, ANGLE])) > np.maximum(0.25, 2.5 * deviations)
    settled = (apart > np.maximum(0.8, 0.06 * sides)) | turned | (resized > RESIZED)
    wrong: BoolArray = np.where(young, (apart > YOUNG_OFFSET * sides) | (resized > YOUNG_RESIZED), settled)
    return wrong


def _overlaps(window: FloatArray, seen: FloatArray) -> FloatArray:
    """Intersection over union of the upright boxes of windows and of detections."""
    sides, upright = detected_sides(seen), upright_sides(window)
    apart = np.abs(window[:, :2] - (seen[:, LEFT:RIGHT] + seen[:, RIGHT:]) / 2)
    shared = np.minimum((sides + upright) / 2 - apart, np.minimum(sides, upright))
    common = np.maximum(shared, 0.0).prod(axis=1)
    return np.asarray(common / (sides.prod(axis=1) + upright.prod(axis=1) - common))


def detected_sides(seen: FloatArray) -> FloatArray:
    """Width and height of detections float64[n, 6]: float64[n, 2], px, 1 at least."""
    return np.maximum(seen[:, RIGHT:] - seen[:, LEFT:RIGHT], 1.0)


def rate_for(rate: float, step_s: float) -> float:
    """A rate for steps of `RATED_S`, converted to another step."""
    return float(1.0 - (1.0 - rate) ** (step_s / RATED_S))


def window_shapes(boxes: FloatArray, headings: FloatArray) -> FloatArray:
    """Lengths and widths float64[n, 2] of rectangles that fill upright boxes float64[n, 2], width and height.

    The lengths lie along the headings float64[n], rad. Box width = length |cos| + width |sin|, box
    height = length |sin| + width |cos|. Near 45 degrees the two equations are one; there a weak pull towards
    a length of twice the width decides.
    """
    cosine, sine = np.abs(np.cos(headings)), np.abs(np.sin(headings))
    pull = ASPECT_WEIGHT**2
    diagonal_length, diagonal_width = 1 + pull, 1 + pull * USUAL_ASPECT**2
    mixed = 2 * cosine * sine - pull * USUAL_ASPECT
    along = cosine * boxes[:, 0] + sine * boxes[:, 1]
    across = sine * boxes[:, 0] + cosine * boxes[:, 1]
    determinant = diagonal_length * diagonal_width - mixed**2
    length = (diagonal_width * along - mixed * across) / determinant
    width = (diagonal_length * across - mixed * along) / determinant
    side = np.maximum(np.sqrt(np.maximum(boxes.prod(axis=1), 1.0)), MINIMUM_SIDE)
    length = np.clip(length, np.maximum(0.3 * side, MINIMUM_SIDE), MAX_ASPECT * side)
    width = np.clip(width, np.maximum(length / MAX_ASPECT, MINIMUM_SIDE), 2.0 * side)
    return np.stack([length, width], axis=1)


def turned_windows(centres: FloatArray, boxes: FloatArray, headings: FloatArray) -> FloatArray:
    """Windows float64[n, 5] in upright boxes: turned into the motion, where that can be.

    A car from above fills its box turned; a person who walks upright through a slanted view does not: no
    rectangle along the motion has that box, to within the noise of a detection. Then the box itself is the
    window.

    Args:
        centres: float64[n, 2], px.
        boxes: float64[n, 2], width and height, px.
        headings: float64[n], directions of motion, rad.
    """
    turned = np.column_stack([centres, window_shapes(boxes, headings), half_turn(headings)])
    deviations = centroid_std(np.sqrt(boxes.prod(axis=1)))[:, None]
    unlike = (np.abs(upright_sides(turned) - boxes) > MAX_DISAGREEMENT * deviations).any(axis=1)
    turned[unlike, 2:4], turned[unlike, 4] = boxes[unlike], 0.0
    return turned


def motion_headings(
    means: FloatArray, covariances: FloatArray, windows: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Directions of motion and their standard deviations, each float64[n], rad.

    What moves slowly for its size may turn on the spot: while the direction is not known it is the window's,
    with an infinite deviation. Means are float64[n, 4], covariances float64[n, 4, 4], windows float64[n, 5].
    """
    speed = np.hypot(means[:, 2], means[:, 3])
    deviation = np.sqrt((covariances[:, 2, 2] + covariances[:, 3, 3]) / 2)
    least = np.maximum(KNOWN_SPEED * deviation, MIN_SPEED * np.sqrt(windows[:, 2] * windows[:, 3]))
    known = (speed >= least) & (speed > 0)
    relative = 1.5 * deviation / np.where(known, speed, 1.0)
    headings = np.where(known, np.arctan2(means[:, 3], means[:, 2]), windows[:, ANGLE])
    return headings, np.where(known, np.maximum(MIN_HEADING_STD, relative), np.inf)
