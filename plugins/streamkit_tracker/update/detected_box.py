"""Size, position and angle of windows from upright detection boxes, once the direction of motion is known.

The window lies on a detection that shows its target alone: its outline has less noise than a search by
appearance. That search refines position and velocity of the filter, and leads where there is no such one.
"""

from __future__ import annotations

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.targets import TENTATIVE, IndexArray, TargetRows, centroid_std
from streamkit_tracker.window_geometry import (
    ANGLE,
    IDENTITY,
    LENGTH,
    MINIMUM_SIDE,
    WIDTH,
    FloatArray,
    half_turn,
    upright_sides,
)

LEFT, RIGHT = 2, 4  # of a detection; before it are x and y of its centroid, behind each its y

OBJECT_RATE, RATED_S = 0.4, 0.04  # per step of so many seconds
# Side of a region, px, from which its outline places a target no worse than a template of 32 px does.
LARGE_SIDE = 32.0
# Share of a detection in the position of the window; the rest is the filter's, which errs more.
DETECTED_SHARE = 0.75
KNOWN_SPEED = 3.0  # standard deviations of the speed from which its direction is known
MIN_SPEED = 0.3  # sides per second, likewise
MIN_HEADING_STD = 0.08  # rad
USUAL_ASPECT = 2.0
ASPECT_WEIGHT = 0.3
MAX_ASPECT = 5.0
UNKNOWN_STD = 1e3  # px, of a target between others that share its region
MAX_DISAGREEMENT = 2.0  # standard deviations of a detection


def follow_detections(
    targets: TargetRows, detected: FloatArray, step_s: float, are_objects: bool = False
) -> None:
    """Lets boxes follow the detections float64[d, 6] that show no other target; sets `whole` and `led`.

    The boxes of a detector (`are_objects`) are smoothed. Targets drawn by hand are never whole; all others
    are with a detector, else the large ones.
    """
    is_shown = (targets["detection"] >= 0) & ~targets["crowded"]
    targets["led"] = is_shown & ~targets["drawn"] & (targets["state"] != TENTATIVE)
    index = np.flatnonzero(is_shown)
    seen = detected[targets["detection"][index]]
    sides = np.maximum(seen[:, RIGHT:] - seen[:, LEFT:RIGHT], 1.0)
    kept = (1.0 - OBJECT_RATE) ** (step_s / RATED_S) if are_objects else 0.0
    targets["box"][index] = targets["box"][index] ** kept * sides ** (1.0 - kept)
    is_large = targets["box"].prod(axis=1) >= LARGE_SIDE**2
    targets["whole"] = ~targets["drawn"] & (are_objects | is_large)


def follow_boxes(targets: TargetRows, detected: FloatArray, are_objects: bool) -> None:
    """Sets the windows of targets that have one of the detections float64[d, 6] of their own.

    Boxes of a detector are smoothed and stay upright. A window has the size of its region of motion, turned
    into the motion where that is known. It lies between the filter's position and the middle of the region,
    or the centre of mass of a small one.
    """
    index = np.flatnonzero(targets["led"])
    if not len(index):
        return
    rows = targets.take(index)
    if are_objects:
        targets["window"][index] = np.column_stack([rows["mean"][:, :2], rows["box"], np.zeros(len(index))])
    else:
        seen = detected[rows["detection"]]
        middles = (seen[:, LEFT:RIGHT] + seen[:, RIGHT:]) / 2
        positions = np.where(rows["whole"][:, None], middles, seen[:, :LEFT])
        # the errors of a detection and of the filter, which follows appearance, are independent
        centres = DETECTED_SHARE * positions + (1 - DETECTED_SHARE) * rows["mean"][:, :2]
        targets["window"][index] = np.concatenate([centres, turned_shapes(rows)[0]], axis=1)
    targets["recognised"][index] = True


def measure_shared(targets: TargetRows, index: IndexArray, region: FloatArray) -> None:
    """Measures the rows `index` by the edges of the region, float64[4], that they share.

    Each edge is that of the outermost target, whose box keeps its size.
    """
    middle, half = targets["mean"][index, :2], targets["box"][index] / 2
    low, high = middle - half, middle + half
    is_low, is_high = low <= low.min(axis=0), high >= high.max(axis=0)
    known = is_low.astype(float) + is_high
    positions = is_low * (region[:2] + half) + is_high * (region[2:] - half)
    stds = np.where(known > 0, centroid_std(2 * np.sqrt(half.prod(axis=1)))[:, None], UNKNOWN_STD)
    targets["measurement"][index] = np.where(known > 0, positions / np.maximum(known, 1.0), middle)
    targets["noise"][index] = stds[:, None] ** 2 * IDENTITY
    targets["measured"][index] = True


@compiled
def window_shapes(boxes: FloatArray, headings: FloatArray) -> FloatArray:
    """Lengths and widths float64[n, 2] of rectangles that fill upright boxes float64[n, 2], width and height.

    The lengths lie along the headings float64[n], rad. Box width = length |cos| + width |sin|, box
    height = length |sin| + width |cos|. Near 45 degrees the two equations are one; there a weak pull towards
    a length of twice the width decides.
    """
    shapes, pull = np.empty((len(boxes), 2)), ASPECT_WEIGHT**2
    diagonal_length, diagonal_width = 1 + pull, 1 + pull * USUAL_ASPECT**2
    for index in range(len(boxes)):
        across_box, down_box = boxes[index]
        cosine, sine = abs(np.cos(headings[index])), abs(np.sin(headings[index]))
        mixed = 2 * cosine * sine - pull * USUAL_ASPECT
        along, across = cosine * across_box + sine * down_box, sine * across_box + cosine * down_box
        determinant = diagonal_length * diagonal_width - mixed**2
        length = (diagonal_width * along - mixed * across) / determinant
        width = (diagonal_length * across - mixed * along) / determinant
        side = max(np.sqrt(max(across_box * down_box, 1.0)), MINIMUM_SIDE)
        length = min(max(length, 0.3 * side, MINIMUM_SIDE), MAX_ASPECT * side)
        width = min(max(width, length / MAX_ASPECT, MINIMUM_SIDE), 2.0 * side)
        shapes[index, 0], shapes[index, 1] = length, width
    return shapes


@compiled
def turned_shapes(targets: TargetRows) -> tuple[FloatArray, FloatArray]:
    """What windows are like in the targets' upright boxes: turned into the motion, where that can be.

    A car from above fills its box turned; a person who walks upright through a slanted view does not: no
    rectangle along the motion has that box, to within the noise of a detection. Then the box itself is the
    window. What moves slowly for its size may turn on the spot: while the direction of its motion is not
    known it is the window's.

    Args:
        targets: n rows of `TARGET`, side by side in memory.

    Returns:
        float64[n, 3], length, width and angle of the windows; and float64[n], standard deviations of the
        directions of motion, rad, infinite where they are not known.
    """
    headings, deviations = np.empty(len(targets)), np.full(len(targets), np.inf)
    boxes, shapes = np.empty((len(targets), 2)), np.empty((len(targets), 3))
    for index in range(len(targets)):
        target = targets[index]
        boxes[index], headings[index] = target["box"], target["window"][ANGLE]
        right, down = target["mean"][2], target["mean"][3]
        speed = np.hypot(right, down)
        deviation = np.sqrt((target["covariance"][2, 2] + target["covariance"][3, 3]) / 2)
        side = np.sqrt(target["window"][LENGTH] * target["window"][WIDTH])
        if speed > 0 and speed >= max(KNOWN_SPEED * deviation, MIN_SPEED * side):
            headings[index] = np.arctan2(down, right)
            deviations[index] = max(MIN_HEADING_STD, 1.5 * deviation / speed)
    shapes[:, :2] = window_shapes(boxes, headings)
    for index in range(len(targets)):
        shapes[index, 2] = half_turn(headings[index])
        across, down = upright_sides(shapes[index, 0], shapes[index, 1], shapes[index, 2])
        error = max(abs(across - boxes[index, 0]), abs(down - boxes[index, 1]))
        if error > MAX_DISAGREEMENT * centroid_std(np.sqrt(boxes[index, 0] * boxes[index, 1])):
            shapes[index, :2], shapes[index, 2] = boxes[index], 0.0
    return shapes, deviations
